"""Pictures as folders of JPEG and PNG with a manifest.csv, for programs that do not read TFRecord.

A shard is a folder `pictures-00003-of-00100` with images/, masks/, edges/ and a manifest.csv of its own; it
appears whole. When all are there, a manifest.csv beside them lists every picture.
"""

import csv
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from laesi_tf.common.atomic_files import write_csv
from laesi_tf.common.errors import InputError
from laesi_tf.data import canny, encoding
from laesi_tf.data.dataset_spec import DatasetSpec

MANIFEST_FILE = "manifest.csv"
COLUMNS = ("image", "mask", "edges", "area_cm2", "px_per_mm", "grid_mm", "species", "prompt", "seed", "index")


def write_shard_folder(
    path: Path, pictures: Iterator[tuple[dict[str, np.ndarray], str]], contents: DatasetSpec
) -> None:
    """Write a shard's folder, whole or not at all. Raises InputError where the disk will not take it."""
    try:
        with tempfile.TemporaryDirectory(
            prefix=f".{path.name}-", dir=path.parent, ignore_cleanup_errors=True
        ) as made:
            temporary = Path(made)
            rows = [_write_sample(temporary, picture, species, contents) for picture, species in pictures]
            write_csv(temporary / MANIFEST_FILE, COLUMNS, rows)
            temporary.chmod(0o755)
            temporary.rename(path)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot write {path} ({reason}); free space and run the command again") from None


def merge_manifests(folder: Path, contents: DatasetSpec) -> None:
    """List every picture in one manifest.csv, once all shards are there."""
    names = [contents.name(shard) for shard in range(contents.shards)]
    if all((folder / name).is_dir() for name in names):
        write_csv(
            folder / MANIFEST_FILE, COLUMNS, (row for name in names for row in _read_rows(folder, name))
        )


def _read_rows(folder: Path, name: str) -> Iterator[list[str]]:
    with (folder / name / MANIFEST_FILE).open(encoding="utf-8", newline="") as file:
        for image, mask, edges, *rest in list(csv.reader(file))[1:]:
            yield [*(f"{name}/{path}" for path in (image, mask, edges)), *rest]


def _write_sample(
    folder: Path, picture: dict[str, np.ndarray], species: str, contents: DatasetSpec
) -> list[object]:
    """Write one picture; its row of the manifest."""
    index = int(picture["index"])
    files = {
        f"images/{index:08}.jpg": encoding.encode_jpeg(picture["image"]),
        f"masks/{index:08}.png": encoding.encode_png(picture["mask"] * 255),
        f"edges/{index:08}.png": encoding.encode_png(canny.detect_canny_edges(picture["mask"])),
    }
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    numbers = f"{picture['area_cm2']:.6g}", f"{picture['px_per_mm']:.6g}", 1
    return [*files, *numbers, species, canny.species_prompt(species), contents.seed, index]
