"""Samples as folders of JPEG and PNG with a manifest.csv, for programs that do not read TFRecord.

A shard is a folder `pictures-00003-of-00100` with images/, masks/, edges/ and a manifest.csv of its own. It
appears completely or not at all. When all shards exist, a manifest.csv beside them lists every sample.
"""

import contextlib
import csv
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from laesi_tf.common.atomic_files import write_csv
from laesi_tf.common.errors import InputError
from laesi_tf.data.canny import detect_canny_edges, species_prompt
from laesi_tf.data.dataset_spec import DatasetSpec
from laesi_tf.data.encoding import encode_jpeg, encode_png
from laesi_tf.data.manifest import MANIFEST_FILE
from laesi_tf.data.sample import ArraySample

COLUMNS = ("image", "mask", "edges", "area_cm2", "px_per_mm", "grid_mm", "species", "prompt", "seed", "index")


def write_shard_folder(path: Path, samples: Iterator[tuple[ArraySample, str]], spec: DatasetSpec) -> None:
    """Write the folder of a shard of (sample, species) pairs. Raises InputError if the disk is full."""
    with shard_folder(path) as folder:
        rows = [_write_sample(folder, sample, species, spec) for sample, species in samples]
        write_csv(folder / MANIFEST_FILE, COLUMNS, rows)


@contextlib.contextmanager
def shard_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`, which on success becomes `path`.

    Raises InputError if the disk is full.
    """
    try:
        with tempfile.TemporaryDirectory(
            prefix=f".{path.name}-", dir=path.parent, ignore_cleanup_errors=True
        ) as name:
            temporary = Path(name)
            yield temporary
            temporary.chmod(0o755)
            temporary.rename(path)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot write {path} ({reason}); free space and run the command again") from None


def find_folder_damage(path: Path, *, count: int) -> str | None:
    """Return what is wrong with a shard's folder, or None if all files of its `count` samples exist."""
    try:
        rows = _read_rows(path.parent, path.name)
        files = [path.parent / name for row in rows for name in row[:3]]
        lost = [file for file in files if not file.is_file() or file.stat().st_size == 0]
    except (OSError, ValueError, csv.Error) as error:
        return f"its {MANIFEST_FILE} cannot be read ({error})"
    if lost:
        return f"it lacks {lost[0].name}"
    return None if len(rows) == count else f"it has {len(rows)} of {count} samples"


def merge_manifests(folder: Path, spec: DatasetSpec) -> None:
    """Write one manifest.csv that lists every sample, if all shards exist."""
    names = [spec.shard_name(shard) for shard in range(spec.shards)]
    if all((folder / name).is_dir() for name in names):
        header = read_table(folder / names[0])[0]
        rows = (row for name in names for row in _read_rows(folder, name))
        write_csv(folder / MANIFEST_FILE, header, rows)


def read_table(shard: Path) -> list[list[str]]:
    """Read the manifest of the folder of a shard: its header, then a row for each sample."""
    with (shard / MANIFEST_FILE).open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def _read_rows(folder: Path, name: str) -> list[list[str]]:
    """Read the manifest of shard `name`, with paths relative to the data set's `folder`."""
    return [
        [*(f"{name}/{path}" for path in (image, mask, edges)), *rest]
        for image, mask, edges, *rest in read_table(folder / name)[1:]
    ]


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write `files`, content by name, below `folder`."""
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)


def _write_sample(folder: Path, sample: ArraySample, species: str, spec: DatasetSpec) -> list[object]:
    """Write the files of one sample and return its row of the manifest."""
    index = int(sample["index"])
    files = {
        f"images/{index:08}.jpg": encode_jpeg(sample["image"]),
        f"masks/{index:08}.png": encode_png(sample["mask"] * 255),
        f"edges/{index:08}.png": encode_png(detect_canny_edges(sample["mask"])),
    }
    write_files(folder, files)
    grid_mm = "" if spec.grid_mm is None else f"{spec.grid_mm:g}"
    numbers = f"{sample['area_cm2']:.6g}", f"{sample['px_per_mm']:.6g}", grid_mm
    return [*files, *numbers, species, species_prompt(species), spec.seed, index]
