"""Prepare the data sets of the experiments: real photos by split, rendered scenes, mixtures."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tensorflow as tf
import tomli_w

from experiments.experiment_specs import Experiment, Job, shorten
from laesi_tf.common.atomic_files import short_sha256, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec, synthetic
from laesi_tf.data.dataset_generation import generate_dataset
from laesi_tf.data.dataset_spec import DatasetSpec
from laesi_tf.data.manifest import MANIFEST_FILE, Photo, read_manifest
from laesi_tf.data.photo_dataset import load_into_memory
from laesi_tf.synthesis import SYNTHESIS_VERSION, load_ranges
from laesi_tf.synthesis.ranges_toml import ranges_to_toml
from laesi_tf.training.tasks.base import Task

SPLITS = ("train", "val", "test")
_PER_SHARD = 1000
_SIDE = 1024
"""Side of the scenes that rules measure: about what they look at of a photo."""


@dataclass(frozen=True, kw_only=True)
class PhotoSplits:
    """The real photos of a manifest, each split shortened to the experiments' scale."""

    manifest: Path
    splits: Mapping[str, list[Photo]]
    """By name from SPLITS."""

    @property
    def counts(self) -> dict[str, int]:
        """How many photos there are in each split."""
        return {name: len(photos) for name, photos in self.splits.items()}

    @property
    def digest(self) -> str:
        """Tells this manifest from another."""
        return short_sha256(self.manifest)

    @property
    def masked(self) -> bool:
        """Whether masks can be learned and judged: each split has some."""
        return all(any(photo.mask for photo in photos) for photos in self.splits.values())


def read_photos(manifest: Path, *, scale: float) -> PhotoSplits:
    """The photos of a manifest with the splits train, val and test. Raises InputError."""
    splits = {name: read_manifest(manifest, split=name) for name in SPLITS}
    shortened = {name: photos[: shorten(len(photos), scale)] for name, photos in splits.items()}
    return PhotoSplits(manifest=manifest, splits=shortened)


def explain_missing_data(trial: Job, folder: Path, *, size: tuple[int, int], scale: float) -> str | None:
    """Why the data sets in `folder` do not do for `trial`, or None where they do."""
    if trial.row.kind != "records":
        return None
    there, least = folder / trial.row.folder, shorten(trial.count, scale)
    try:
        contents = dataset_spec.read_spec(there)
    except InputError as error:
        return str(error)
    if contents.format != "records" or contents.size != size:
        return f"{there} does not hold records of {size[0]} x {size[1]} pixels"
    return None if contents.count >= least else f"{there} holds {contents.count} pictures, not {least}"


def write_mixture(
    path: Path, trial: Job, photos: PhotoSplits, folder: Path, *, size: int, scale: float
) -> None:
    """Write what `trial` is trained on as a mixture: every picture comes as often, as in the paper.

    Scenes are made first where they are not there yet, once for all trials. Raises InputError.
    """
    sources: dict[str, dict[str, Any]] = {
        "photos": {
            "kind": "photos",
            "manifest": str(photos.manifest.resolve()),
            "split": "train",
            "count": photos.counts["train"],
        }
    }
    row, count = trial.row, shorten(trial.count, scale)
    if row.kind == "scenes":
        made = _ensure_scenes(row, folder, size=size, scale=scale)
        sources["scenes"] = {"kind": "records", "folder": str(made.resolve()), "count": count}
    elif row.kind == "records":
        there = folder / row.folder
        sources["inpainted"] = {"kind": "records", "folder": str(there.resolve()), "count": count}
    text = tomli_w.dumps(sources)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def _ensure_scenes(row: Experiment, folder: Path, *, size: int, scale: float) -> Path:
    """A data set of as many scenes as any count of `row` asks for; smaller counts take its first ones.

    Each is of another leaf: that is what 5K pictures picked from the paper's 100K nearly are, in which every
    leaf is seen in four lights.
    """
    count = shorten(max(row.counts), scale)
    return _ensure_dataset(row, folder / f"{row.name}-{count}x{size}", count=count, size=size)


def generate_square_photos(trial: Job, folder: Path, *, scale: float) -> list[Photo]:
    """Scenes with red squares as photos, their scale kept secret: rules are to find it."""
    count = shorten(trial.count, scale)
    name = f"{trial.row.name}-{count}x{_SIDE}-{trial.seed}"
    made = _ensure_dataset(trial.row, folder / name, count=count, size=_SIDE, seed=trial.seed, form="folder")
    return [replace(photo, px_per_mm=None) for photo in read_manifest(made / MANIFEST_FILE)]


def _ensure_dataset(
    row: Experiment, path: Path, *, count: int, size: int, seed: int = 0, form: str = "records"
) -> Path:
    """The data set in `path`, made or completed where need be."""
    ranges = load_ranges(row.scenes).with_passes(1)
    contents = DatasetSpec(
        count=count,
        size=(size, size),
        per_shard=_PER_SHARD,
        seed=seed,
        format=form,
        ranges=ranges_to_toml(ranges),
        synthesis_version=SYNTHESIS_VERSION,
    )
    generate_dataset(contents, ranges, path)
    return path


def make_validation_batches(
    photos: Iterable[Photo], *, task: Task, size: int, batch_size: int
) -> tf.data.Dataset:
    """`photos` once, in memory, as batches to validate on. Raises InputError when none can be used."""
    pictures, _ = load_into_memory(list(photos), size=(size, size), needs_masks=task.needs_masks)
    return synthetic.batch_samples(
        tf.data.Dataset.range(pictures.count).map(pictures.get),
        make_target=task.make_target,
        batch_size=batch_size,
    )
