"""generate: parts of many machines, continuation after a kill, damaged shards, both formats."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import only

from laesi_tf import generate
from laesi_tf.common.errors import InputError
from laesi_tf.data import tfrecords
from laesi_tf.data.dataset_generation import generate_dataset
from laesi_tf.data.dataset_spec import DatasetSpec
from laesi_tf.data.decoding import decode_mask, decode_photo
from laesi_tf.data.manifest import MANIFEST_FILE, read_manifest

SIZE = (48, 64)
SIMPLE = only("ruling")


def make_spec(**changes: object) -> DatasetSpec:
    options = {"count": 10, "size": SIZE, "per_shard": 4, "seed": 3, "ranges": ""}
    return DatasetSpec(**options | changes)  # type: ignore[arg-type]


def files(folder: Path) -> dict[str, bytes]:
    """Return the content of every file below a folder, hidden ones included, by its path."""
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "set"
    figures = generate_dataset(make_spec(), SIMPLE, folder)
    assert figures["pictures"] == 10 and figures["shards"] == 3 and figures["mb"] > 0
    return folder


def test_the_parts_of_many_machines_equal_the_whole(whole: Path, tmp_path: Path) -> None:
    fractions = ((1, 2), (0, 2))
    metrics = [generate_dataset(make_spec(), SIMPLE, tmp_path, shard_fraction=part) for part in fractions]
    assert [part["pictures"] for part in metrics] == [4, 6]
    assert files(tmp_path) == files(whole)


def test_records_hold_the_samples_of_training(whole: Path) -> None:
    samples = list(tfrecords.read_samples(whole).as_numpy_iterator())
    assert [int(sample["index"]) for sample in samples] == list(range(10))
    kinds = {sample["prompt"].decode().removesuffix(" leaf on millimeter paper") for sample in samples}
    assert kinds <= set(SIMPLE.leaf)
    # Four lighting passes over a leaf.
    areas = [float(sample["area_cm2"]) for sample in samples]
    assert len(set(areas)) == 3 and areas[0] == areas[3] != areas[4]


def test_an_interrupted_run_continues_without_duplicate_or_gap(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode, calls = tfrecords.encode_record, []

    def failing(*arguments: object, **options: object) -> bytes:
        calls.append(1)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return encode(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(tfrecords, "encode_record", failing)
    with pytest.raises(KeyboardInterrupt):
        generate_dataset(make_spec(), SIMPLE, tmp_path)
    assert [path.name for path in tmp_path.glob("*.tfrecord")] == [make_spec().shard_name(0)]
    figures = generate_dataset(make_spec(), SIMPLE, tmp_path)
    assert figures["shards_already_there"] == 1 and figures["pictures"] == 6
    assert files(tmp_path) == files(whole)


def test_killed_and_continued(tmp_path: Path) -> None:
    ranges = tmp_path / "simple.toml"
    names = ", ".join(f'"{name}"' for name in sorted(SIMPLE.without))
    ranges.write_text(f"without = [{names}]\n")
    options = ["--count", "60", "--size", "32", "--per-shard", "10", "--ranges", str(ranges)]
    out = tmp_path / "killed"
    arguments = [sys.executable, "-m", "laesi_tf.generate", *options, "--out", str(out)]
    running = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not list(out.glob("pictures*.tfrecord")):
        assert running.poll() is None
        time.sleep(0.02)
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    shards = len(list(out.glob("pictures*.tfrecord")))
    assert 1 <= shards < 6
    report = tmp_path / "figures.json"
    generate.main([*options, "--out", str(out), "--json", str(report)])
    figures = json.loads(report.read_text())
    assert figures["shards_already_there"] == shards and figures["pictures"] == 60 - 10 * shards
    generate.main([*options, "--out", str(tmp_path / "whole")])
    assert files(out) == files(tmp_path / "whole")


def test_folders_are_a_manifest_of_photos(whole: Path, tmp_path: Path) -> None:
    described = make_spec(format="folder")
    generate_dataset(described, SIMPLE, tmp_path, shard_fraction=(1, 2))
    assert not (tmp_path / MANIFEST_FILE).exists()
    generate_dataset(described, SIMPLE, tmp_path)
    photos = read_manifest(tmp_path / MANIFEST_FILE)
    expected = list(tfrecords.read_samples(whole).as_numpy_iterator())
    assert len(photos) == 10
    for photo, sample in zip(photos, expected, strict=True):
        assert photo.area_cm2 == pytest.approx(float(sample["area_cm2"]), rel=1e-5)
        assert photo.px_per_mm == pytest.approx(float(sample["px_per_mm"]), rel=1e-5)
        assert photo.mask is not None and photo.grid_mm == 1
        np.testing.assert_array_equal(decode_mask(photo.mask), sample["mask"] == 1)
        assert np.abs(decode_photo(photo.image).astype(int) - sample["image"]).mean() < 1
        edges = cv2.imread(str(photo.image).replace("images", "edges").replace("jpg", "png"), -1)
        np.testing.assert_array_equal(edges, sample["edges"] * 255)
    assert not list(tmp_path.glob(".*"))


def test_another_data_set_in_the_same_folder_is_refused(whole: Path) -> None:
    with pytest.raises(InputError, match="holds another data set"):
        generate_dataset(make_spec(seed=4), SIMPLE, whole)


@pytest.mark.parametrize("part", ["2/2", "1", "a/b", "-1/2"])
def test_impossible_parts_are_refused(part: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--shard"):
        generate.main(["--count", "1", "--out", str(tmp_path / "set"), f"--shard={part}"])


@pytest.mark.parametrize("form", ["records", "folder"])
def test_a_damaged_shard_is_named_and_generated_again(whole: Path, tmp_path: Path, form: str) -> None:
    spec = make_spec(format=form)
    if form == "records":
        shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    else:
        generate_dataset(spec, SIMPLE, tmp_path)
    expected = files(tmp_path)
    shard = tmp_path / spec.shard_name(1)
    broken = shard if form == "records" else next((shard / "masks").iterdir())
    broken.write_bytes(broken.read_bytes()[:-20] if form == "records" else b"")
    with pytest.warns(UserWarning, match=f"{shard.name} is damaged and is generated again"):
        metrics = generate_dataset(spec, SIMPLE, tmp_path)
    assert metrics["shards"] == 1 and metrics["pictures"] == 4
    assert files(tmp_path) == expected


def test_a_negative_seed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--seed.*whole number from 0 up"):
        generate.main(["--count", "1", "--out", str(tmp_path / "set"), "--seed=-3"])
