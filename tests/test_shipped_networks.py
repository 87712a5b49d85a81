"""The shipped LiteRT files hold the shipped weights and today's stages: `laesi export --format package --out
laesi_tf/pretrained` writes them anew."""

from pathlib import Path

import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from green import photo

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.run_files import EXPORTED_WEIGHTS_FILE, NETWORK_FILE, PRETRAINED, READING_FILE
from laesi_tf.estimators import keras_networks, litert_networks
from laesi_tf.estimators.base import LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.litert_file import read_litert_file
from laesi_tf.estimators.parameters import replace_parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid, average_levels, put_in_frame
from laesi_tf.estimators.ruling import sheet_reader as reader_module
from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling.spectra import build_pyramid
from laesi_tf.exporting import package
from laesi_tf.exporting.litert_check import Picture
from laesi_tf.exporting.package import check_package
from laesi_tf.models.ruling_cells import FRAME_PX

TASKS = ("area", "mask", "ruling")
MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}


@pytest.mark.parametrize(
    ("task", "name"), [*((task, NETWORK_FILE) for task in TASKS), ("ruling", READING_FILE)]
)
def test_each_file_names_the_weights_beside_it(task: str, name: str) -> None:
    metadata = read_litert_file(PRETRAINED / task / name).metadata
    kind = "reading" if name == READING_FILE else task
    assert (metadata["kind"], metadata["licence"]) == (kind, "Apache-2.0")
    assert metadata["networks"][task].endswith(short_sha256(PRETRAINED / task / EXPORTED_WEIGHTS_FILE))


def test_masks_are_those_of_the_keras_weights() -> None:
    in_keras = keras_networks.load_mask_run(PRETRAINED / "mask")
    in_litert = litert_networks.load_mask_network(PRETRAINED / "mask")
    images = np.stack([photo(224, 224), np.random.default_rng(0).integers(0, 256, (224, 224, 3), np.uint8)])
    expected, found = (estimator._predict(images) for estimator in (in_keras, in_litert))
    assert found.shape == (2, 224, 224, 1) and expected[0].max() > 0.9
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_areas_are_those_of_the_keras_weights() -> None:
    pyramid = PhotoPyramid(photo(300, 400))
    expected = keras_networks.load_area_run(PRETRAINED / "area").predict_area(pyramid)
    found = litert_networks.load_area_network(PRETRAINED / "area").predict_area(pyramid)
    assert found.area_cm2 == pytest.approx(expected.area_cm2, rel=1e-4)
    assert found.px_per_mm == pytest.approx(expected.px_per_mm, rel=1e-4)


VIEWS = {
    "wide, needs the full resolution": (View(720, 960, px_per_mm=5.0, tilt=(0.15, -0.1)), MILLIMETRES),
    "tall, distorted": (View(960, 720, px_per_mm=12.0, k1=0.03), {1.0: 0.6, 10.0: 1.0}),
    "fives only, refused": (View(600, 800), {5.0: 0.8}),
    "no lines": (View(600, 800), {1.0: 0.0}),
}


@pytest.mark.parametrize("name", VIEWS)
def test_rulings_are_read_as_in_tensorflow(
    name: str, sheet_reader: SheetReader, keras_sheet_reader: SheetReader
) -> None:
    view, levels = VIEWS[name]
    frame = put_in_frame(draw_photo(view, levels).astype(np.uint8))
    found, expected = (
        reader._read_frame(frame, (view.height, view.width), None)
        for reader in (sheet_reader, keras_sheet_reader)
    )
    assert found.keys() == expected.keys()
    for key in ("refusal", "note"):
        assert found[key] == expected[key]
    if "refused" in name or "no lines" in name:
        assert found["refusal"] != 0
        return
    assert found["refusal"] == 0
    np.testing.assert_array_equal(found["heavier"], expected["heavier"])
    np.testing.assert_allclose(found["agreement"], expected["agreement"], atol=1e-3)
    # Slopes are periods per half the longer side; 0.005 % of a scale is 0.01 % of an area.
    slope = np.abs(expected["parameters"][2:6]).max()
    np.testing.assert_allclose(found["parameters"][2:6], expected["parameters"][2:6], atol=5e-5 * slope)
    assert found["phase_error"] == pytest.approx(float(expected["phase_error"]), rel=0.01, abs=1e-4)


def test_the_network_sees_a_large_image_in_parts_as_if_whole(
    sheet_reader: SheetReader, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = draw_photo(View(768, 768), MILLIMETRES).astype(np.uint8)
    whole = sheet_reader._ask_in_parts(image)
    monkeypatch.setattr(reader_module, "_LARGEST_PX", 500_000)
    np.testing.assert_allclose(sheet_reader._ask_in_parts(image), whole, atol=1e-3)


def test_levels_are_exactly_those_of_the_graph() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (FRAME_PX, FRAME_PX, 3), np.uint8)
    for level, expected in zip(
        average_levels(frame, 3), build_pyramid(frame.astype(np.float32), 4)[1:], strict=True
    ):
        np.testing.assert_array_equal(level, expected)


class Constant:
    """Measures the same area on all pictures."""

    def __init__(self, area_cm2: float) -> None:
        self.area_cm2 = area_cm2

    def measure(self, image: np.ndarray, info: PhotoInfo) -> Measurement:
        del image, info
        return Measurement(method="constant", leaves=(LeafMeasurement(area_cm2=self.area_cm2),))


@pytest.mark.parametrize(("in_litert", "are_kept"), [(10.0005, True), (10.002, False)])
def test_files_whose_areas_differ_are_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_litert: float, are_kept: bool
) -> None:
    for task in TASKS:
        (tmp_path / task).mkdir()
        (tmp_path / task / NETWORK_FILE).write_bytes(b"graph")
    monkeypatch.setattr(
        package, "load_estimator", lambda in_keras, **_: Constant(10.0 if in_keras else in_litert)
    )
    scores = list(check_package(tmp_path, [Picture(photo(32, 32), 10.0, None)]))
    assert [score.is_kept for score in scores] == [True, are_kept, True, are_kept]
    assert all((tmp_path / task / NETWORK_FILE).exists() == are_kept for task in TASKS)


def test_parameters_in_the_file_cannot_be_replaced(sheet_reader: SheetReader) -> None:
    params = RulingReaderParams()
    with pytest.raises(ValueError, match="converted with"):
        sheet_reader.with_params(replace_parameter(params, "reading.levels.heavy", 1e9))
    assert sheet_reader.with_params(replace_parameter(params, "sheet_agreement", 2.0)).params != params
