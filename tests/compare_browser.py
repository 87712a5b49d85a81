"""Compare the page in headless Chromium with LiteRT in Python, on the same decoded pixels.

    python tests/compare_browser.py PAGE PHOTOS [--split SPLIT] [--photos N]

PAGE is a folder that `laesi web` wrote, PHOTOS a manifest or a folder. Photos go to the page as PNG, since
browsers and Pillow decode JPEG a little differently.
"""

import argparse
import contextlib
import statistics
import sys
import tempfile
import time
from pathlib import Path

import chromium
from PIL import Image
from web_pages import list_exceptions, measure_files, open_page, serve

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.manifest import read_manifest
from laesi_tf.estimators.base import PhotoInfo
from laesi_tf.estimators.litert_estimator import load_litert_estimator
from laesi_tf.exporting.web.sentences import replace_flags


def list_photos(source: Path, split: str | None) -> list[Path]:
    """Return the photos of a manifest, or those in a folder that can be decoded."""
    if source.is_file():
        return [photo.image for photo in read_manifest(source, split=split)]
    photos = []
    for path in sorted(source.iterdir()):
        with contextlib.suppress(InputError):
            decode_photo(path)
            photos.append(path)
    return photos


def main() -> None:
    """Print a line for each photo, then the largest difference and the median times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("source", type=Path, metavar="PHOTOS")
    parser.add_argument("--split")
    parser.add_argument("--photos", type=int, default=20)
    options = parser.parse_args()
    photos = list_photos(options.source, options.split)[: options.photos]
    estimator = load_litert_estimator(options.page / "photo.tflite")
    worst, differing, times, python_times, memory = 0.0, 0, [], [], []
    with (
        tempfile.TemporaryDirectory() as folder,
        serve(options.page) as address,
        chromium.Browser() as browser,
    ):
        open_page(browser, address)
        for number, photo in enumerate(photos):
            image = decode_photo(photo)
            path = Path(folder) / f"{number}.png"
            Image.fromarray(image).save(path, compress_level=1)
            started = time.perf_counter()
            expected = estimator.measure(image, PhotoInfo())
            python_times.append((time.perf_counter() - started) * 1e3)
            (shown,) = measure_files(browser, [path])
            times.append(shown["milliseconds"])
            memory.append(browser.measure_memory_mb())
            refusal = shown["measurement"]["refusal"]
            areas = [leaf.get("area_cm2") for leaf in shown["measurement"]["leaves"]]
            wanted = [leaf.area_cm2 for leaf in expected.leaves]
            is_same = len(areas) == len(wanted) and refusal == (
                expected.refusal and replace_flags(expected.refusal)
            )
            differing += not is_same
            if is_same and refusal is None:
                difference = max(abs(a / b - 1) for a, b in zip(areas, wanted, strict=True))
                worst = max(worst, difference)
                print(f"{photo.name:<40}  {sum(wanted):8.3f} cm2  {difference:.1e}", flush=True)
            else:
                print(f"{photo.name:<40}  {refusal} / {expected.refusal}", flush=True)
        exceptions = list_exceptions(browser)
    print(f"photos: {len(photos)}, refusals or numbers of leaves that differ: {differing}")
    print(f"largest relative difference of an area: {worst:.1e}")
    print(
        f"median time per photo: page {statistics.median(times):.0f} ms in the graph and around it, "
        f"Python {statistics.median(python_times):.0f} ms"
    )
    early, late = memory[len(memory) // 4], memory[-1]
    print(f"memory of the browser: {early:.0f} MB after a quarter, {late:.0f} MB at the end")
    sys.exit(1 if differing or exceptions else 0)


if __name__ == "__main__":
    main()
