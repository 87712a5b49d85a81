"""TFRecord shards: reading gives what was written; damaged and missing shards are named."""

import dataclasses
import json
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tensorflow as tf
from record_sets import SIZE, SPEC, render_samples, write_dataset

from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "set"
    write_dataset(path)
    return path


def test_shards_hold_every_sample_once() -> None:
    assert SPEC.shards == 3
    assert [list(SPEC.sample_indices(shard)) for shard in range(3)] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    assert SPEC.shard_name(2) == "pictures-00002-of-00003.tfrecord"


def test_reading_gives_what_was_written(folder: Path) -> None:
    assert dataset_spec.read_spec(folder) == SPEC
    samples = list(tfrecords.read_samples(folder).as_numpy_iterator())
    assert len(samples) == 10
    for sample, expected in zip(samples, render_samples(), strict=True):
        for name in ("mask", "area_cm2", "px_per_mm", "tilt_deg", "to_px", "index"):
            np.testing.assert_array_equal(sample[name], expected[name], err_msg=name)
        np.testing.assert_array_equal(sample["edges"] * 255, cv2.Canny(expected["mask"] * 255, 100, 200))
        apart = np.abs(sample["image"].astype(int) - expected["image"])
        assert apart.mean() < 2 and sample["image"].shape == (*SIZE, 3)
        assert sample["prompt"] == b"oak" and sample["seed"] == 3


def test_the_same_sample_gives_the_same_bytes() -> None:
    one, again = (tfrecords.encode_record(render_samples()[0], seed=3, prompt="ä") for _ in range(2))
    assert one == again


def test_shuffled_gives_all_again_and_again_in_a_new_order(folder: Path) -> None:
    stream = tfrecords.shuffle_samples(folder, seed=1)
    indices = [int(sample["index"]) for sample in stream.take(30)]
    epochs = [indices[:10], indices[10:20], indices[20:]]
    assert all(sorted(epoch) == list(range(10)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) == 3
    assert [
        int(sample["index"]) for sample in tfrecords.shuffle_samples(folder, seed=1, start=13).take(17)
    ] == indices[13:]


def test_a_single_shard_is_shuffled_anew_as_well(tmp_path: Path) -> None:
    write_dataset(tmp_path, dataclasses.replace(SPEC, per_shard=SPEC.count))
    indices = [int(sample["index"]) for sample in tfrecords.shuffle_samples(tmp_path, seed=1).take(30)]
    assert len({tuple(indices[first : first + 10]) for first in (0, 10, 20)}) == 3
    tf.random.set_seed(9)
    assert [
        int(sample["index"]) for sample in tfrecords.shuffle_samples(tmp_path, seed=1).take(30)
    ] == indices


def test_shuffled_stays_within_a_count(folder: Path) -> None:
    indices = [int(sample["index"]) for sample in tfrecords.shuffle_samples(folder, seed=1, count=6).take(12)]
    assert sorted(indices[:6]) == sorted(indices[6:]) == list(range(6))


def test_missing_shards_and_broken_data_sets_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no data set in .*make one with generate"):
        tfrecords.read_samples(tmp_path)
    copy = tmp_path / "copy"
    dataset_spec.start_dataset(copy, SPEC)
    dataset_spec.start_dataset(copy, SPEC)  # to continue is no error
    with pytest.raises(InputError, match=r"lacks 3 of 3 shards, the first pictures-00000"):
        tfrecords.read_samples(copy)
    with pytest.raises(InputError, match="holds another data set, which differs in count;"):
        dataset_spec.start_dataset(copy, DatasetSpec(count=9, size=SIZE, per_shard=4, seed=3, ranges=""))
    (copy / dataset_spec.SPEC_FILE).write_text("{}")
    with pytest.raises(InputError, match="is broken"):
        tfrecords.read_samples(copy)
    (tmp_path / "busy").mkdir()
    (tmp_path / "busy" / "letter.txt").touch()
    with pytest.raises(InputError, match="neither empty nor a data set"):
        dataset_spec.start_dataset(tmp_path / "busy", SPEC)


def test_a_full_disk_leaves_no_shard(tmp_path: Path) -> None:
    script = (
        "import sys, pathlib\n"
        "from laesi_tf.data import tfrecords\n"
        "from laesi_tf.common.errors import InputError\n"
        "try: tfrecords.write_shard(pathlib.Path(sys.argv[1]), [bytes(1000)] * 500)\n"
        "except InputError as error: print(error)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "shard")],
        capture_output=True,
        text=True,
        check=True,
        # A limit on a file's size stands in for a full disk: writes fail in the same place.
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )
    assert "cannot write" in ran.stdout and "free space" in ran.stdout
    assert list(tmp_path.iterdir()) == []


def test_reading_works_where_tensorflow_reads_alone(folder: Path) -> None:
    raw = tf.data.TFRecordDataset(sorted(map(str, folder.glob("*.tfrecord"))))
    features = tf.train.Example.FromString(next(iter(raw)).numpy()).features.feature
    assert features["image"].bytes_list.value[0][:2] == b"\xff\xd8"
    assert features["area_cm2"].float_list.value[0] == pytest.approx(float(render_samples()[0]["area_cm2"]))


def damage_by_truncating(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-30])


def damage_by_dropping_records(path: Path) -> None:
    tfrecords.write_shard(path, [record.numpy() for record in tf.data.TFRecordDataset(str(path)).take(2)])


def damage_by_changing_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (damage_by_truncating, "truncated"),
        (damage_by_dropping_records, "2 of 4 samples"),
        (damage_by_changing_a_byte, "checksums"),
    ],
)
def test_damaged_shards_are_named(folder: Path, tmp_path: Path, damage, message: str) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    shard = copy / SPEC.shard_name(1)
    assert tfrecords.find_damage(shard, count=4) is None
    damage(shard)
    assert message in str(tfrecords.find_damage(shard, count=4))
    if damage is not damage_by_changing_a_byte:  # reading its lengths alone does not show it
        with pytest.raises(InputError, match=f"{shard.name} is truncated; run the command that wrote"):
            tfrecords.shuffle_samples(copy, seed=0)


def test_a_data_set_of_before_versions_were_recorded_is_of_version_1(folder: Path, tmp_path: Path) -> None:
    values = json.loads((folder / dataset_spec.SPEC_FILE).read_text())
    del values["synthesis_version"]
    (tmp_path / dataset_spec.SPEC_FILE).write_text(json.dumps(values))
    assert dataset_spec.read_spec(tmp_path).synthesis_version == 1
    newer = dataclasses.replace(SPEC, synthesis_version=2)
    with pytest.raises(InputError, match="differs in synthesis_version"):
        dataset_spec.start_dataset(tmp_path, newer)
