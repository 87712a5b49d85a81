"""Parameters of estimators and the benchmark that changes them."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from green import LEAF, area_network, disk, mask_network, photo

from laesi_tf.benchmarks.sensitivity import (
    Accuracy,
    LabelledPhoto,
    format_table,
    measure_accuracy,
    measure_sensitivity,
    require_tunable,
    scale_value,
    select_parameters,
    to_json,
)
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.easy_leaf_area import EasyLeafArea, EasyLeafAreaParams
from laesi_tf.estimators.keras_networks import make_area_estimator, make_mask_estimator
from laesi_tf.estimators.parameters import list_parameters, parameter, replace_parameter
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.ruling_estimator import RulingEstimator, RulingEstimatorParams

ALL_PARAMS = (RulingEstimatorParams(), EasyLeafAreaParams())


@dataclasses.dataclass(frozen=True)
class Stage:
    area: float = parameter(10.0, unit="cm2")
    unused: int = parameter(1, unit="pixels")


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: Stage = dataclasses.field(default_factory=Stage)
    refuse_below: float = parameter(2.0, unit="levels")


class Constant:
    """An estimator that returns its parameter as area and refuses images darker than another."""

    def __init__(self, params: Outer | None = None) -> None:
        self.params = params or Outer()

    def with_params(self, params: Outer) -> "Constant":
        return Constant(params)

    def measure(self, image: np.ndarray, info: PhotoInfo = UNKNOWN) -> Measurement:
        leaf = LeafMeasurement(area_cm2=self.params.inner.area, uncertainty_cm2=1.0)
        refusal = "dark" if image.mean() < self.params.refuse_below else None
        return Measurement(method="constant", leaves=(leaf,), refusal=refusal)


PHOTOS = [LabelledPhoto(np.full((2, 2, 3), level), 10.0, UNKNOWN) for level in (3, 100)]


def test_parameters_of_inner_stages_have_dotted_names() -> None:
    names = [known.name for known in list_parameters(Outer())]
    assert names == ["inner.area", "inner.unused", "refuse_below"]
    changed = replace_parameter(Outer(), "inner.area", 3.0)
    assert (changed.inner.area, changed.refuse_below, Outer().inner.area) == (3.0, 2.0, 10.0)
    with pytest.raises(KeyError):
        replace_parameter(Outer(), "inner.volume", 1.0)


@pytest.mark.parametrize("params", ALL_PARAMS, ids=lambda params: type(params).__name__)
def test_every_parameter_names_its_unit_and_data(params: Any) -> None:
    known = list(list_parameters(params))
    assert len(known) > 5 and all(one.unit and one.set_on for one in known)


def test_each_parameter_is_halved_and_doubled() -> None:
    base = measure_accuracy(Constant(), PHOTOS)
    assert base == Accuracy(mre=0.0, coverage=1.0, refused=0)
    results = list(measure_sensitivity(Constant(), PHOTOS, select_parameters(Outer(), [])))
    assert [result.halved.mre for result in results] == [50.0, 0.0, 0.0]
    assert [result.doubled.mre for result in results] == [100.0, 0.0, 0.0]
    assert [result.doubled.refused for result in results] == [0, 0, 1]
    assert results[0].halved.coverage == 0.0
    table = format_table(base, results, count=2)
    assert "inner.area = 10" in table and "+50.00 /  +100.00" in table and len(table.splitlines()) == 7
    assert to_json(base, results)["parameters"]["refuse_below"]["doubled"]["refused"] == 1


def test_parameters_are_selected_by_prefix() -> None:
    assert [known.name for known in select_parameters(Outer(), ["inner"])] == ["inner.area", "inner.unused"]
    with pytest.raises(InputError, match="'outer'"):
        select_parameters(Outer(), ["outer"])


def test_an_estimator_without_parameters_is_refused() -> None:
    assert require_tunable(Constant()).params == Outer()
    with pytest.raises(InputError, match="--model"):
        require_tunable(make_area_estimator(area_network((64, 64)), (64, 64), "none"))


def test_whole_numbers_stay_whole() -> None:
    assert (
        scale_value(5, 0.5) == 2 and scale_value(1, 0.5) == 1 and scale_value((1.0, 0.5), 2.0) == (2.0, 1.0)
    )


def test_estimators_use_the_parameters_that_they_are_given(sheet_reader: SheetReader) -> None:
    size = (96, 96)
    mask = make_mask_estimator(mask_network(size), size)
    info = PhotoInfo(px_per_mm=4.0)
    coarse = mask.with_params(replace_parameter(mask.params, "outline.min_area_px", 1e9))
    assert coarse.measure(photo(300, 300), info).refusal is not None
    assert mask.measure(photo(300, 300), info).refusal is None
    guesser = make_area_estimator(area_network(size), size, "none")
    ruling = RulingEstimator(mask, sheet_reader, guesser=guesser)
    wider = ruling.with_params(replace_parameter(ruling.params, "guess_factor", 1.8))
    one, other = (estimator.measure(photo(200, 200)) for estimator in (ruling, wider))
    assert other.uncertainty_cm2 == pytest.approx(2 * (one.uncertainty_cm2 or 0.0))
    blind = ruling.with_params(replace_parameter(ruling.params, "mask.outline.min_area_px", 1e9))
    assert blind.measure(photo(200, 200)).refusal is not None
    assert EasyLeafArea().with_params(EasyLeafAreaParams(square_cm2=9.0)).params.square_cm2 == 9.0


def test_the_parameters_of_the_ruling_reader_reach_it(keras_sheet_reader: SheetReader) -> None:
    size = (96, 96)
    estimator = RulingEstimator(make_mask_estimator(mask_network(size), size), keras_sheet_reader)
    image = draw_photo(View(600, 800), {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}).astype(np.uint8)
    image[disk(600, 800, radius=0.2)] = LEAF
    names = [known.name for known in select_parameters(estimator.params, ["ruling.judge.fewest"])]
    assert names == ["ruling.judge.fewest_cells", "ruling.judge.fewest_windows"]
    strict = estimator.with_params(replace_parameter(estimator.params, names[0], 1_000_000))
    assert estimator.measure(image).camera is not None
    assert strict.measure(image).camera is None
