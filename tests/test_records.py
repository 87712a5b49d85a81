"""TFRecord shards: what goes in comes out, and nothing half-written."""

import dataclasses
import resource
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tensorflow as tf
from scenes import only

from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec, synthetic, tfrecords
from laesi_tf.data.dataset_spec import DatasetSpec

SIZE = (48, 64)
CONTENTS = DatasetSpec(count=10, size=SIZE, per_shard=4, seed=3, ranges="")


def scenes(count: int = 10) -> list[dict[str, np.ndarray]]:
    made = synthetic.synthetic_samples(seed=3, size=SIZE, ranges=only("ruling"), count=count, passes=1)
    return list(made.as_numpy_iterator())


def fill(folder: Path, contents: DatasetSpec = CONTENTS) -> None:
    """A whole data set of `contents`."""
    pictures = scenes(contents.count)
    dataset_spec.start_dataset(folder, contents)
    for shard in range(contents.shards):
        encoded = [
            tfrecords.encode_record(pictures[i], seed=3, prompt="oak") for i in contents.pictures(shard)
        ]
        tfrecords.write_shard(folder / contents.name(shard), encoded)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("data") / "set"
    fill(made)
    return made


def test_shards_hold_every_picture_once() -> None:
    assert CONTENTS.shards == 3
    assert [list(CONTENTS.pictures(shard)) for shard in range(3)] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    assert CONTENTS.name(2) == "pictures-00002-of-00003.tfrecord"


def test_what_goes_in_comes_out(folder: Path) -> None:
    assert dataset_spec.read_spec(folder) == CONTENTS
    found = list(tfrecords.read_samples(folder).as_numpy_iterator())
    assert len(found) == 10
    for picture, expected in zip(found, scenes(), strict=True):
        for name in ("mask", "area_cm2", "px_per_mm", "tilt_deg", "to_px", "index"):
            np.testing.assert_array_equal(picture[name], expected[name], err_msg=name)
        np.testing.assert_array_equal(picture["edges"] * 255, cv2.Canny(expected["mask"] * 255, 100, 200))
        apart = np.abs(picture["image"].astype(int) - expected["image"])
        assert apart.mean() < 2 and picture["image"].shape == (*SIZE, 3)
        assert picture["prompt"] == b"oak" and picture["seed"] == 3


def test_the_same_picture_gives_the_same_bytes() -> None:
    one, again = (tfrecords.encode_record(scenes(1)[0], seed=3, prompt="ä") for _ in range(2))
    assert one == again


def test_shuffled_gives_all_again_and_again_in_a_new_order(folder: Path) -> None:
    stream = tfrecords.shuffle_samples(folder, seed=1)
    found = [int(picture["index"]) for picture in stream.take(30)]
    epochs = [found[:10], found[10:20], found[20:]]
    assert all(sorted(epoch) == list(range(10)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) == 3
    assert [
        int(picture["index"]) for picture in tfrecords.shuffle_samples(folder, seed=1, start=13).take(17)
    ] == found[13:]


def test_a_single_shard_is_shuffled_anew_as_well(tmp_path: Path) -> None:
    fill(tmp_path, dataclasses.replace(CONTENTS, per_shard=CONTENTS.count))
    found = [int(picture["index"]) for picture in tfrecords.shuffle_samples(tmp_path, seed=1).take(30)]
    assert len({tuple(found[first : first + 10]) for first in (0, 10, 20)}) == 3
    tf.random.set_seed(9)
    assert [
        int(picture["index"]) for picture in tfrecords.shuffle_samples(tmp_path, seed=1).take(30)
    ] == found


def test_shuffled_stays_within_a_count(folder: Path) -> None:
    found = [int(picture["index"]) for picture in tfrecords.shuffle_samples(folder, seed=1, count=6).take(12)]
    assert sorted(found[:6]) == sorted(found[6:]) == list(range(6))


def test_missing_shards_and_broken_data_sets_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no data set in .*make one with generate"):
        tfrecords.read_samples(tmp_path)
    copy = tmp_path / "copy"
    dataset_spec.start_dataset(copy, CONTENTS)
    dataset_spec.start_dataset(copy, CONTENTS)  # to continue is no error
    with pytest.raises(InputError, match=r"lacks 3 of 3 shards, the first pictures-00000"):
        tfrecords.read_samples(copy)
    with pytest.raises(InputError, match="holds another data set"):
        dataset_spec.start_dataset(copy, DatasetSpec(count=9, size=SIZE, per_shard=4, seed=3, ranges=""))
    (copy / dataset_spec.SPEC_FILE).write_text("{}")
    with pytest.raises(InputError, match="is broken"):
        tfrecords.read_samples(copy)
    (tmp_path / "busy").mkdir()
    (tmp_path / "busy" / "letter.txt").touch()
    with pytest.raises(InputError, match="neither empty nor a data set"):
        dataset_spec.start_dataset(tmp_path / "busy", CONTENTS)


def test_a_full_disk_leaves_no_shard(tmp_path: Path) -> None:
    script = (
        "import sys, pathlib\n"
        "from laesi_tf.data import records\n"
        "from laesi_tf.common.errors import InputError\n"
        "try: records.write_shard(pathlib.Path(sys.argv[1]), [bytes(1000)] * 500)\n"
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
    assert features["area_cm2"].float_list.value[0] == pytest.approx(float(scenes(1)[0]["area_cm2"]))
