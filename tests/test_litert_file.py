"""Exported files: what they say about themselves, and what is refused."""

from pathlib import Path

import keras
import numpy as np
import pytest
import tensorflow as tf
from green import area_network, mask_network, photo

from laesi_tf.common.errors import InputError
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.estimators.litert_estimator import LiteRtAreaEstimator
from laesi_tf.estimators.litert_file import LiteRtRunner, read_litert_file, write_litert_file
from laesi_tf.exporting.litert import NetworkGraph, convert, describe
from laesi_tf.models.saved_model import ModelSpec, Run

SIZE = (64, 64)


def make_graph(task: str, network: keras.Model) -> object:
    spec = ModelSpec(task=task, backbone="small", alpha=1.0, size=SIZE, transform="none")
    return NetworkGraph(Run(Path(task), spec, network)).predict.get_concrete_function()


@pytest.fixture(scope="module")
def area_model() -> bytes:
    return convert(make_graph("area", area_network(SIZE)), "float32")


@pytest.fixture
def area_file(area_model: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "area.tflite"
    write_litert_file(path, area_model, describe("area", {}) | {"input_size": list(SIZE)})
    return path


def test_an_area_file_measures_as_its_network(area_file: Path) -> None:
    estimator = load_estimator(area_file)
    assert isinstance(estimator, LiteRtAreaEstimator)
    image = photo(128, 128)
    small = tf.image.resize(image, SIZE, method="bilinear", antialias=True)
    expected = float(area_network(SIZE)(small[None])[0, 0])
    assert estimator.measure(image).area_cm2 == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("variant", ["float16", "dynamic"])
def test_smaller_variants_of_a_mask_network_keep_their_weights(variant: str) -> None:
    graph = make_graph("mask", mask_network(SIZE))
    image = photo(*SIZE)
    model = convert(graph, variant)
    leaf = LiteRtRunner(model)(photo=image)["leaf"]
    expected = mask_network(SIZE)(image[None].astype(np.float32))[0, ..., 0]
    assert np.isfinite(leaf).all() and ((leaf > 0.5) == (expected > 0.5)).numpy().all()


def test_a_file_tells_what_it_is(area_file: Path, area_model: bytes) -> None:
    file = read_litert_file(area_file)
    assert file.model == area_model
    assert file.metadata["kind"] == "area" and "cm2" in file.metadata["outputs"]["area_cm2"]
    codes = describe("photo", {})["refusals"]
    assert codes["0"] == "none" and codes["11"] == "mostly_uncounted" and len(codes) == 12


def test_what_is_not_ours_is_refused_in_one_line(area_file: Path, area_model: bytes, tmp_path: Path) -> None:
    content = area_file.read_bytes()
    damaged = bytearray(content)
    damaged[1000] ^= 1
    broken = {
        "empty": b"",
        "a picture": b"\xff\xd8\xff\xe0" * 100,
        "cut off": content[: len(content) // 2],
        "without metadata": area_model,
        "damaged": bytes(damaged),
    }
    for name, data in broken.items():
        path = tmp_path / f"{name}.tflite"
        path.write_bytes(data)
        with pytest.raises(InputError) as refused:
            load_estimator(path)
        assert "\n" not in str(refused.value) and name in str(refused.value)
    with pytest.raises(InputError, match="cannot read"):
        load_estimator(tmp_path / "missing.tflite")
    mask = tmp_path / "mask.tflite"
    write_litert_file(mask, area_model, describe("mask", {}))
    with pytest.raises(InputError, match="kind 'mask'"):
        load_estimator(mask)
