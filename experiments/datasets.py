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
_SQUARE_PHOTO_SIDE = 1024
"""Side in pixels of the scenes that the rules measure: about the resolution at which they look at a photo."""


@dataclass(frozen=True, kw_only=True)
class PhotoSplits:
    """The real photos of a manifest by split, each split shortened to the experiments' scale."""

    manifest: Path
    splits: Mapping[str, list[Photo]]
    """By name from SPLITS."""

    @property
    def counts(self) -> dict[str, int]:
        """The number of photos in each split."""
        return {name: len(photos) for name, photos in self.splits.items()}

    @property
    def digest(self) -> str:
        """The hash of the manifest."""
        return short_sha256(self.manifest)

    @property
    def has_masks(self) -> bool:
        """Whether every split has a photo with a mask, so that masks can be trained and evaluated."""
        return all(any(photo.mask for photo in photos) for photos in self.splits.values())


def read_photos(manifest: Path, *, scale: float) -> PhotoSplits:
    """Read the photos of a manifest with the splits train, val and test. Raises InputError."""
    splits = {name: read_manifest(manifest, split=name) for name in SPLITS}
    shortened = {name: photos[: shorten(len(photos), scale)] for name, photos in splits.items()}
    return PhotoSplits(manifest=manifest, splits=shortened)


def explain_missing_data(job: Job, folder: Path, *, size: tuple[int, int], scale: float) -> str | None:
    """Return why the data sets in `folder` are not sufficient for `job`; None if they are."""
    if job.experiment.data_type != "records":
        return None
    path, count = folder / job.experiment.folder, shorten(job.count, scale)
    try:
        spec = dataset_spec.read_spec(path)
    except InputError as error:
        return str(error)
    if spec.format != "records" or spec.size != size:
        return f"{path} does not hold records of {size[0]} x {size[1]} pixels"
    return None if spec.count >= count else f"{path} holds {spec.count} images; {count} are needed"


def write_mixture(
    path: Path, job: Job, photos: PhotoSplits, folder: Path, *, size: int, scale: float
) -> None:
    """Write the training data of `job` as a mixture of equally frequent images, as in the paper.

    Scenes are rendered first unless an earlier job did. Raises InputError.
    """
    sources: dict[str, dict[str, Any]] = {
        "photos": {
            "kind": "photos",
            "manifest": str(photos.manifest.resolve()),
            "split": "train",
            "count": photos.counts["train"],
        }
    }
    experiment, count = job.experiment, shorten(job.count, scale)
    if experiment.data_type == "scenes":
        scenes = _ensure_scenes(experiment, folder, size=size, scale=scale)
        sources["scenes"] = {"kind": "records", "folder": str(scenes.resolve()), "count": count}
    elif experiment.data_type == "records":
        records = folder / experiment.folder
        sources["inpainted"] = {"kind": "records", "folder": str(records.resolve()), "count": count}
    text = tomli_w.dumps(sources)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)


def _ensure_scenes(experiment: Experiment, folder: Path, *, size: int, scale: float) -> Path:
    """Return a data set of as many scenes as the largest count asks for; smaller counts use its first ones.

    Each scene has a leaf of its own: 5,000 images picked from the paper's 100,000, in which every leaf is
    rendered in four lights, nearly do.
    """
    count = shorten(max(experiment.counts), scale)
    return _ensure_dataset(experiment, folder / f"{experiment.name}-{count}x{size}", count=count, size=size)


def generate_square_photos(job: Job, folder: Path, *, scale: float) -> list[Photo]:
    """Return rendered scenes with red squares as photos of unknown scale, which the rules must find."""
    count = shorten(job.count, scale)
    path = _ensure_dataset(
        job.experiment,
        folder / f"{job.experiment.name}-{count}x{_SQUARE_PHOTO_SIDE}-{job.seed}",
        count=count,
        size=_SQUARE_PHOTO_SIDE,
        seed=job.seed,
        form="folder",
    )
    return [replace(photo, px_per_mm=None) for photo in read_manifest(path / MANIFEST_FILE)]


def _ensure_dataset(
    experiment: Experiment, path: Path, *, count: int, size: int, seed: int = 0, form: str = "records"
) -> Path:
    """Return the data set in `path`, generated or completed if need be."""
    ranges = load_ranges(experiment.scene_ranges).with_passes(1)
    spec = DatasetSpec(
        count=count,
        size=(size, size),
        per_shard=_PER_SHARD,
        seed=seed,
        format=form,
        ranges=ranges_to_toml(ranges),
        synthesis_version=SYNTHESIS_VERSION,
    )
    generate_dataset(spec, ranges, path)
    return path


def make_validation_batches(
    photos: Iterable[Photo], *, task: Task, size: int, batch_size: int
) -> tf.data.Dataset:
    """Return `photos`, kept in memory, as validation batches. Raises InputError if none is usable."""
    samples, _ = load_into_memory(list(photos), size=(size, size), needs_masks=task.needs_masks)
    dataset = tf.data.Dataset.range(samples.count).map(samples.get)
    return synthetic.batch_samples(dataset, make_target=task.make_target, batch_size=batch_size)
