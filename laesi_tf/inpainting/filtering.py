"""Divide a repainted data set into images that fit their masks and images that do not.

Each shard's deviations are written as soon as they are known, so a stopped run continues. Then the samples
are copied into two data sets, `accepted` and `rejected`, numbered anew without gaps; each sample keeps its
number as `source_index` and has its `deviation`.
"""

import csv
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.atomic_files import read_json, short_sha256, write_csv, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.run_files import BEST_MODEL_FILE, EXPORTED_WEIGHTS_FILE, PRETRAINED
from laesi_tf.data.dataset_generation import find_missing_shards, remove_partial_shard
from laesi_tf.data.dataset_spec import DatasetSpec, read_spec, start_dataset
from laesi_tf.data.image_folders import merge_manifests
from laesi_tf.data.stored_samples import STORED_FORMATS, StoredSample, require_complete
from laesi_tf.inpainting.consistency import LeafSegmenter, mask_deviation
from laesi_tf.inpainting.repainting import INPAINTING_FILE

FILTER_FILE = "filter.json"
"""Settings of the filter; distinguishes its folder from others."""
DEVIATIONS_FILE = "deviations.csv"
ACCEPTED, REJECTED = "accepted", "rejected"
_COLUMNS = ("index", "deviation", "imperfection")
_BATCH_SIZE = 16


@dataclass(frozen=True)
class FilterResult:
    """Deviations [N] of all samples in order, and the name of each one's deliberate imperfection or ""."""

    deviations: NDArray[np.float64]
    imperfections: Sequence[str]
    max_deviation: float

    @property
    def is_accepted(self) -> NDArray[np.bool_]:
        """Whether each sample is kept, [N]."""
        return self.deviations <= self.max_deviation

    @property
    def rejection_rate(self) -> float:
        """Share of the samples that are dropped."""
        return float(1 - self.is_accepted.mean())

    def summarise_imperfections(self) -> dict[str, dict[str, float]]:
        """Return the count and the rejection rate for each kind of imperfection, "" for none."""
        kinds = np.array(self.imperfections)
        return {
            str(kind): {
                "count": int((kinds == kind).sum()),
                "rejection_rate": float(1 - self.is_accepted[kinds == kind].mean()),
            }
            for kind in sorted(set(self.imperfections))
        }


def filter_dataset(source: Path, out: Path, *, mask_run: Path | None, max_deviation: float) -> FilterResult:
    """Divide the data set in `source`, and write `accepted`, `rejected` and the deviations to `out`.

    `mask_run` is the training run of the segmenter, by default the one that comes with the package. Raises
    InputError.
    """
    spec = read_spec(source)
    require_complete(source, spec)
    segmenter = LeafSegmenter(mask_run)
    _start_filter(out, source, spec, mask_run=mask_run, max_deviation=max_deviation)
    rows = list(_measure_deviations(source, out, spec, segmenter))
    result = FilterResult(
        np.array([float(deviation) for _, deviation, _ in rows]),
        [imperfection for *_, imperfection in rows],
        max_deviation,
    )
    for name, is_chosen in ((ACCEPTED, result.is_accepted), (REJECTED, ~result.is_accepted)):
        _copy_samples(source, spec, out / name, is_chosen, result.deviations)
    write_csv(
        out / DEVIATIONS_FILE,
        (*_COLUMNS, "accepted"),
        [(*row, int(kept)) for row, kept in zip(rows, result.is_accepted, strict=True)],
    )
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class FilteredExample:
    """An image for people to look at, with the true mask and the one that the network finds."""

    image: RgbImage
    true: Mask
    found: Mask
    deviation: float
    is_accepted: bool


def load_examples(
    source: Path, result: FilterResult, *, mask_run: Path | None, count: int
) -> list[FilteredExample]:
    """Load `count` accepted and `count` rejected examples at most, by increasing deviation.

    Both are the samples closest to the limit, half of them, and evenly spaced among all others.
    """
    order = np.argsort(result.deviations, kind="stable")
    chosen = []
    for kept in (True, False):
        ranked = [int(number) for number in order if result.is_accepted[number] == kept]
        chosen += _pick_examples(ranked, count, starts_at_limit=not kept)
    samples = dict(_read_positions(source, set(chosen)))
    images = [samples[position].decode_image() for position in chosen]
    found = LeafSegmenter(mask_run).segment(images) if chosen else []
    return [
        FilteredExample(
            image=image,
            true=samples[position].decode_mask(),
            found=mask,
            deviation=float(result.deviations[position]),
            is_accepted=bool(result.is_accepted[position]),
        )
        for position, image, mask in zip(chosen, images, found, strict=True)
    ]


def _pick_examples(ranked: list[int], count: int, *, starts_at_limit: bool) -> list[int]:
    if len(ranked) <= count:
        return ranked
    near = count // 2
    rest, closest = (ranked[near:], ranked[:near]) if starts_at_limit else (ranked[:-near], ranked[-near:])
    spaced = [rest[int(place)] for place in np.linspace(0, len(rest) - 1, count - near).round()]
    return closest + spaced if starts_at_limit else spaced + closest


def _read_positions(source: Path, positions: set[int]) -> Iterator[tuple[int, StoredSample]]:
    """Yield (position, sample) of the samples at `positions` of the data set."""
    spec = read_spec(source)
    for shard in range(spec.shards):
        indices = spec.sample_indices(shard)
        if positions.isdisjoint(indices):
            continue
        samples = STORED_FORMATS[spec.format].read(source / spec.shard_name(shard))
        for position, sample in zip(indices, samples, strict=True):
            if position in positions:
                yield position, sample


def _measure_deviations(
    source: Path, out: Path, spec: DatasetSpec, segmenter: LeafSegmenter
) -> Iterator[tuple[int, str, str]]:
    """Yield a row of `_COLUMNS` for each sample, from the tables of earlier runs where they exist."""
    bar: Any = progress_bar([], total=spec.count, desc="segmenting", unit="picture")
    for shard in range(spec.shards):
        name = spec.shard_name(shard)
        table = out / "deviations" / f"{name}.csv"
        if not table.is_file():
            samples = STORED_FORMATS[spec.format].read(source / name)
            rows = [row for batch in _split_batches(samples) for row in _compare(batch, segmenter, name, bar)]
            write_csv(table, _COLUMNS, rows)
        else:
            bar.update(len(spec.sample_indices(shard)))
        with table.open(encoding="utf-8", newline="") as file:
            for index, deviation, imperfection in itertools.islice(csv.reader(file), 1, None):
                yield int(index), deviation, imperfection
    bar.close()


def _compare(
    samples: Sequence[StoredSample], segmenter: LeafSegmenter, where: str, bar: Any
) -> list[tuple[int, str, str]]:
    found = segmenter.segment([sample.decode_image() for sample in samples])
    rows = []
    for sample, mask in zip(samples, found, strict=True):
        true = sample.decode_mask()
        if not true.any():
            raise InputError(f"the mask of image {sample.index} in {where} is empty: nothing to compare with")
        imperfection = str(sample.values.get("imperfection", ""))
        rows.append((sample.index, f"{mask_deviation(mask, true):.6f}", imperfection))
    bar.update(len(samples))
    return rows


def _split_batches(samples: Iterator[StoredSample]) -> Iterator[list[StoredSample]]:
    while batch := list(itertools.islice(samples, _BATCH_SIZE)):
        yield batch


def _copy_samples(
    source: Path, spec: DatasetSpec, out: Path, is_chosen: NDArray[np.bool_], deviations: NDArray[np.float64]
) -> None:
    """Write the chosen samples as a data set, of which shards that exist already are kept; none if empty."""
    count = int(is_chosen.sum())
    if not count:
        return
    chosen_spec = replace(spec, count=count)
    start_dataset(out, chosen_spec)
    stored = STORED_FORMATS[spec.format]
    missing = find_missing_shards(range(chosen_spec.shards), chosen_spec, out, remedy="written again")
    positions = np.flatnonzero(is_chosen)
    for shard in missing:
        indices = chosen_spec.sample_indices(shard)
        wanted = positions[indices.start : indices.stop]
        samples = _read_positions(source, {int(position) for position in wanted})
        remove_partial_shard(out / chosen_spec.shard_name(shard))
        stored.write(
            out / chosen_spec.shard_name(shard),
            (
                sample.with_values(
                    index=index, source_index=sample.index, deviation=float(deviations[position])
                )
                for index, (position, sample) in zip(indices, samples, strict=True)
            ),
        )
    if spec.format == "folder":
        merge_manifests(out, chosen_spec)


def _start_filter(
    out: Path, source: Path, spec: DatasetSpec, *, mask_run: Path | None, max_deviation: float
) -> None:
    """Write the settings to `out`, or continue there. Raises InputError for other settings."""
    expected = {
        "max_deviation": max_deviation,
        "mask_run": _describe_weights(mask_run or PRETRAINED / "mask"),
        "source": asdict(spec) | {"size": list(spec.size)},
        "inpainting": read_json(source / INPAINTING_FILE) if (source / INPAINTING_FILE).is_file() else None,
    }
    path = out / FILTER_FILE
    if path.is_file():
        present = read_json(path)
        differing = sorted(key for key in expected if expected[key] != present.get(key))
        if differing:
            raise InputError(
                f"{out} holds the result of another filter, which differs in {', '.join(differing)}; name "
                "another --out"
            )
    elif out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is neither empty nor the result of a filter; name another --out")
    else:
        write_json(path, expected)


def _describe_weights(run: Path) -> str:
    """Return a digest of the weights of `run`."""
    exported = run / EXPORTED_WEIGHTS_FILE
    return short_sha256(exported if exported.is_file() else run / BEST_MODEL_FILE)
