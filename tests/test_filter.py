"""filter: what it measures, what it keeps, its data sets, its continuation; faults that it must reject."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tensorflow as tf
from green import PAPER, disk, photo, save_run
from PIL import Image

from laesi_tf import filter as filter_command
from laesi_tf.benchmarks import filter_faults
from laesi_tf.benchmarks.repainting_faults import FAULTS, PaintedLeaf
from laesi_tf.common.errors import InputError
from laesi_tf.data import synthetic, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec, read_spec, start_dataset
from laesi_tf.data.image_folders import merge_manifests, write_shard_folder
from laesi_tf.data.manifest import MANIFEST_FILE, read_manifest
from laesi_tf.inpainting.consistency import LeafSegmenter, mask_deviation

pytestmark = pytest.mark.usefixtures("stand_in_networks")

SIZE = (64, 64)
SPEC = DatasetSpec(count=10, size=SIZE, per_shard=4, seed=3, ranges="")
FAULTY = (2, 3, 7)


@pytest.fixture(scope="module")
def mask_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_run(tmp_path_factory.mktemp("runs") / "mask", "mask", size=SIZE)


def draw_sample(index: int) -> dict[str, Any]:
    """Return a sample of a round leaf; the images of FAULTY show less than half of it."""
    image, mask = photo(*SIZE), disk(*SIZE)
    if index in FAULTY:
        image[:, : SIZE[1] // 2 + index] = PAPER
    numbers = {"area_cm2": 10 + index, "px_per_mm": 2, "tilt_deg": 0, "to_px": np.eye(3)}
    return {
        "image": image,
        "mask": mask.astype(np.uint8),
        "index": np.int64(index),
        **{name: np.float32(value) for name, value in numbers.items()},
    }


def write_set(folder: Path, spec: DatasetSpec = SPEC) -> Path:
    start_dataset(folder, spec)
    for shard in range(spec.shards):
        pairs = [(draw_sample(index), "oak") for index in spec.sample_indices(shard)]
        write = write_shard_folder if spec.format == "folder" else tfrecords.write_samples
        write(folder / spec.shard_name(shard), iter(pairs), spec)
    if spec.format == "folder":
        merge_manifests(folder, spec)
    return folder


def run(dataset: Path, mask_run: Path, *arguments: str) -> None:
    filter_command.main([str(dataset), "--mask-run", str(mask_run), *arguments])


def test_deviation_sees_what_a_difference_of_areas_does_not() -> None:
    true = disk(64, 64)
    assert mask_deviation(true, true) == 0
    assert mask_deviation(np.zeros_like(true), true) == 1
    moved = np.roll(true, 6, axis=1)
    assert moved.sum() == true.sum() and mask_deviation(moved, true) > 0.3
    doubled = np.roll(true, 32, axis=1) | np.roll(true, -32, axis=1) | true
    assert mask_deviation(doubled, true) > 0.5


def test_the_segmenter_answers_at_the_size_of_the_images(mask_run: Path) -> None:
    segmenter = LeafSegmenter(mask_run)
    for size in ((64, 64), (96, 80), (40, 40)):
        found = segmenter.segment([photo(*size), photo(*size, radius=0.2)])
        for mask, radius in zip(found, (0.3, 0.2), strict=True):
            assert mask.shape == size and mask_deviation(mask, disk(*size, radius=radius)) < 0.15


def test_faulty_images_are_kept_apart(mask_run: Path, tmp_path: Path) -> None:
    dataset, report = write_set(tmp_path / "set"), tmp_path / "figures.json"
    run(dataset, mask_run, "--json", str(report))
    out = tmp_path / "set-filtered"
    assert json.loads(report.read_text())["rejection_rate"] == pytest.approx(0.3)
    kept = [index for index in range(SPEC.count) if index not in FAULTY]
    for name, expected in (("accepted", kept), ("rejected", list(FAULTY))):
        samples = list(tfrecords.read_samples(out / name).as_numpy_iterator())
        assert [float(sample["area_cm2"]) for sample in samples] == [10 + index for index in expected]
        # Numbered anew: readers take the first `count` by their index.
        assert [int(sample["index"]) for sample in samples] == list(range(len(expected)))
        assert read_spec(out / name) == replace(SPEC, count=len(expected))
    shuffled = tfrecords.shuffle_samples(out / "accepted", seed=0, count=5).take(5)
    assert sorted(int(sample["index"]) for sample in shuffled.as_numpy_iterator()) == list(range(5))
    with (out / "deviations.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["index"]) for row in rows if row["accepted"] == "0"] == list(FAULTY)
    assert all((float(row["deviation"]) > 0.15) == (int(row["index"]) in FAULTY) for row in rows)
    for name in ("histogram.png", "examples.png"):
        assert Image.open(out / name).size[0] > 300


def test_accepted_records_store_their_deviation(mask_run: Path, tmp_path: Path) -> None:
    run(write_set(tmp_path / "set"), mask_run)
    schema = {name: tf.io.FixedLenFeature([], tf.int64) for name in ("index", "source_index")}
    schema |= {"deviation": tf.io.FixedLenFeature([], tf.float32)}
    paths = [str(path) for path in sorted((tmp_path / "set-filtered/rejected").glob("*.tfrecord"))]
    records = [tf.io.parse_single_example(record, schema) for record in tf.data.TFRecordDataset(paths)]
    assert [int(record["source_index"]) for record in records] == list(FAULTY)
    assert all(0.3 < float(record["deviation"]) < 1 for record in records)


def test_a_stopped_run_continues(mask_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = write_set(tmp_path / "set")
    run(dataset, mask_run, "--out", str(tmp_path / "whole"))
    segment, calls = LeafSegmenter.segment, []

    def interrupted(segmenter: LeafSegmenter, images: Any) -> Any:
        calls.append(len(images))
        if len(calls) == 2:
            raise KeyboardInterrupt
        return segment(segmenter, images)

    monkeypatch.setattr(LeafSegmenter, "segment", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(dataset, mask_run, "--out", str(tmp_path / "parts"))
    calls[:] = [0, 0]
    run(dataset, mask_run, "--out", str(tmp_path / "parts"))
    # The second and third shard, and the examples.
    assert calls[2:] == [4, 2, 10]
    whole, parts = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in (tmp_path / "whole", tmp_path / "parts")
    )
    assert whole == parts


def test_another_filter_does_not_overwrite(mask_run: Path, tmp_path: Path) -> None:
    dataset = write_set(tmp_path / "set")
    run(dataset, mask_run)
    run(dataset, mask_run)
    with pytest.raises(InputError, match="differs in max_deviation; name another --out"):
        run(dataset, mask_run, "--max-deviation", "0.2")
    with pytest.raises(InputError, match="neither empty nor the result of a filter"):
        run(dataset, mask_run, "--out", str(dataset))


def test_where_nothing_is_rejected_there_is_no_rejected_set(mask_run: Path, tmp_path: Path) -> None:
    run(write_set(tmp_path / "set"), mask_run, "--max-deviation", "5")
    assert not (tmp_path / "set-filtered/rejected").exists()
    assert read_spec(tmp_path / "set-filtered/accepted") == SPEC


def test_folders_become_folders(mask_run: Path, tmp_path: Path) -> None:
    run(write_set(tmp_path / "set", replace(SPEC, format="folder")), mask_run)
    photos = read_manifest(tmp_path / "set-filtered/accepted" / MANIFEST_FILE)
    assert [photo.area_cm2 for photo in photos] == [10, 11, 14, 15, 16, 18, 19]
    assert (
        photos[2].image.read_bytes()
        == (
            tmp_path / "set" / replace(SPEC, format="folder").shard_name(1) / "images/00000004.jpg"
        ).read_bytes()
    )


def test_bad_input(mask_run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no data set in"):
        run(tmp_path / "nowhere", mask_run)
    dataset = write_set(tmp_path / "set")
    with pytest.raises(InputError, match="no run in"):
        run(dataset, tmp_path / "nowhere")
    with pytest.raises(InputError, match="--task mask"):
        run(dataset, save_run(tmp_path / "area", "area"))
    with pytest.raises(InputError, match="--max-deviation"):
        run(dataset, mask_run, "--max-deviation", "0")
    assert not (tmp_path / "set-filtered").exists()
    (dataset / SPEC.shard_name(1)).unlink()
    with pytest.raises(InputError, match="lacks 1 of 3 shards"):
        run(dataset, mask_run)


@pytest.fixture
def painted() -> PaintedLeaf:
    return PaintedLeaf(photo(*SIZE), disk(*SIZE), np.random.default_rng(1))


@pytest.mark.parametrize("kind", FAULTS)
def test_faults_stay_inside_the_mask_and_grow_with_their_severity(kind: str, painted: PaintedLeaf) -> None:
    missing = []
    for severity in FAULTS[kind].severities:
        fault = FAULTS[kind].apply(painted, severity)
        np.testing.assert_array_equal(fault.image[~painted.mask], painted.image[~painted.mask])
        assert not (fault.leaf & ~painted.mask).any()
        missing.append(1 - fault.leaf.sum() / painted.mask.sum())
        if kind in ("bitten", "missing"):
            assert missing[-1] == pytest.approx(severity, abs=0.04)
    assert missing == sorted(missing)


def test_the_benchmark_rejects_gross_faults_and_keeps_faithful_leaves(
    mask_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = {"image": photo(*SIZE), "mask": disk(*SIZE).astype(np.uint8)}
    scenes = tf.data.Dataset.from_tensors(scene).repeat(4)
    monkeypatch.setattr(synthetic, "synthetic_samples", lambda **_: scenes)
    metrics = filter_faults.measure_filter(
        count=4, seed=0, size=SIZE, ranges="", max_deviation=0.15, mask_run=mask_run
    )
    rejected = {(case["kind"], case["severity"]): case["rejected"] for case in metrics["cases"]}
    assert rejected["faithful", 0.0] == 0
    for kind in FAULTS:
        if kind != "faithful":
            assert rejected[kind, FAULTS[kind].severities[-1]] == 1, kind
    for kind in ("shifted", "scaled", "bitten", "missing"):
        assert rejected[kind, FAULTS[kind].severities[0]] == 0, kind
    table = filter_faults.format_table(metrics)
    assert len(table.splitlines()) == len(metrics["cases"]) + 4 and "4 images of 64 x 64" in table
