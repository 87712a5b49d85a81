"""Exported files are measured on the same pictures as their parents, and bad ones are not kept."""

import json
import math
from pathlib import Path

import keras
import numpy as np
import pytest
import tensorflow as tf
from green import area_network, disk, mask_network, photo

from laesi_tf.estimators.litert_file import LiteRtRunner, read_litert_file
from laesi_tf.exporting import app_folder
from laesi_tf.exporting.app_folder import Networks, export_litert, write_guide
from laesi_tf.exporting.half_weights import halve_weights
from laesi_tf.exporting.litert_check import HEADER, FileScore, Picture, is_as_good
from laesi_tf.models.saved_model import ModelSpec, Run

SIZE = (64, 64)


@pytest.fixture
def networks(tmp_path: Path) -> Networks:
    runs = []
    for task, network in (("area", area_network(SIZE)), ("mask", mask_network(SIZE)), ("ruling", None)):
        path = tmp_path / task
        path.mkdir()
        (path / "weights.npz").write_bytes(task.encode())
        spec = ModelSpec(task=task, backbone="small", alpha=1.0, size=SIZE, transform="none")
        runs.append(Run(path, spec, network))
    return Networks(*runs)


@pytest.fixture
def pictures() -> list[Picture]:
    shapes = [(128, 128, 0.3), (100, 160, 0.25), (160, 100, 0.4)]
    return [
        Picture(photo(height, width, radius=radius), 100 * mask.mean(), mask)
        for height, width, radius in shapes
        for mask in [disk(height, width, radius=radius)]
    ]


@pytest.fixture
def only_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = dict.fromkeys(("area", "mask"), ("float32", "float16"))
    monkeypatch.setattr(app_folder, "VARIANTS", kinds)


@pytest.mark.usefixtures("only_networks")
def test_files_are_written_measured_and_explained(
    networks: Networks, pictures: list[Picture], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    scores = list(export_litert(networks, out, pictures, calibration=[], variants=("float32", "float16")))
    write_guide(out, pictures[0])
    names = [
        f"laesi-{kind}-{variant}.tflite" for kind in ("area", "mask") for variant in ("float16", "float32")
    ]
    texts = {"README.md", "golden.json", "golden.png"}
    assert {path.name for path in out.iterdir()} == {*names, *texts}
    parents = [score for score in scores if score.name.endswith("Keras")]
    assert len(scores) == 6 and len(parents) == 2 and all(score.is_kept for score in scores)
    for score in scores:
        assert len(score.as_row()) >= len(HEADER) - 2 and score.host_ms > 0
        if score not in parents:
            assert score.worst_difference < 0.1 and score.size_mb > 1e-3
    details = read_litert_file(out / names[0]).metadata
    assert details["variant"] == "float16" and details["licence"] == "Apache-2.0"
    assert details["networks"]["area"].startswith("area, sha256 ")
    assert str(tmp_path) not in json.dumps(details)
    golden = json.loads((out / "golden.json").read_text())
    assert golden[names[0]]["leaves"][0]["area_cm2"] == pytest.approx(pictures[0].area_cm2, rel=0.05)
    text = (out / "README.md").read_text()
    assert "```kotlin" in text and "```swift" in text


@pytest.mark.usefixtures("only_networks")
def test_a_file_that_is_worse_is_not_kept(
    networks: Networks, pictures: list[Picture], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def convert_badly(graph: tuple[tf.Module, object], variant: str, calibration: object) -> bytes:
        function = tf.function(
            lambda photo: {"area_cm2": tf.reduce_mean(tf.cast(photo, tf.float32)), "leaf": tf.zeros(SIZE)},
            input_signature=[tf.TensorSpec([*SIZE, 3], tf.uint8, "photo")],
        )
        module = tf.Module()
        converter = tf.lite.TFLiteConverter.from_concrete_functions(
            [function.get_concrete_function()], module
        )
        return bytes(converter.convert())

    monkeypatch.setattr(app_folder, "convert", convert_badly)
    earlier = tmp_path / "laesi-area-float32.tflite"
    earlier.write_bytes(b"of an earlier export")
    scores = list(export_litert(networks, tmp_path, pictures, calibration=[], variants=("float32",)))
    assert [score.is_kept for score in scores] == [True, False, True, False]
    assert "not kept" in scores[1].as_row()
    assert not list(tmp_path.glob("*.tflite"))


def make_score(**values: float) -> FileScore:
    given = {"mre": math.nan, "miou": math.nan, "refused": 0} | values
    return FileScore(name="x", size_mb=1, worst_difference=0, host_ms=1, **given)  # type: ignore[arg-type]


def test_half_a_point_and_one_refusal_in_twenty_are_allowed() -> None:
    parent = make_score(mre=1.0, refused=2)
    assert is_as_good(make_score(mre=1.5, refused=3), parent, count=20)
    assert not is_as_good(make_score(mre=1.51, refused=2), parent, count=20)
    assert not is_as_good(make_score(mre=1.0, refused=4), parent, count=20)
    assert not is_as_good(make_score(refused=20), parent, count=20)
    masks = make_score(miou=0.99)
    assert is_as_good(make_score(miou=0.985), masks, count=20)
    assert not is_as_good(make_score(miou=0.984), masks, count=20)


def test_only_weights_become_float16() -> None:
    """Whole numbers above 2,048, such as labels, have no float16."""
    image = keras.Input((32, 32, 3))
    network = keras.Model(image, keras.layers.Conv2D(64, 3)(image))
    weights = network.get_weights()

    @tf.function(input_signature=[tf.TensorSpec([32, 32, 3], tf.float32, "image")])
    def run(image: tf.Tensor) -> dict[str, tf.Tensor]:
        features = tf.nn.conv2d(image[None], tf.constant(weights[0]), 1, "VALID")[0]
        places = tf.constant(np.arange(32 * 32, dtype=np.float32).reshape(32, 32) + 5000.0)
        return {"features": features, "sum": tf.reduce_sum(image[..., 0] * places)}

    module = tf.Module()
    converter = tf.lite.TFLiteConverter.from_concrete_functions([run.get_concrete_function()], module)
    whole = bytes(converter.convert())
    half = halve_weights(whole)
    assert len(half) < len(whole) - 2500
    random = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    first, second = (LiteRtRunner(model)(image=random) for model in (whole, half))
    np.testing.assert_allclose(second["features"], first["features"], atol=2e-3)
    assert (first["features"] != second["features"]).any() and first["sum"] == second["sum"]
