"""Benchmark `sensitivity`: measure how much each parameter of an estimator matters.

Each parameter is halved and doubled while the others stay as they are. A parameter whose change makes no
difference is not needed; one that improves a result is not set well for these photos.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
import tensorflow as tf

from laesi_tf.common import metrics
from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.manifest import Photo
from laesi_tf.estimators.base import UNKNOWN, Estimator, Measurement, PhotoInfo
from laesi_tf.estimators.parameters import Parameter, list_parameters, replace_parameter
from laesi_tf.synthesis import load_ranges, synthesise

_PASSES = 4
"""Successive indices that show the same leaf."""


class TunableEstimator(Protocol):
    """An estimator whose parameters can be replaced."""

    @property
    def params(self) -> Any:
        """The parameters of its stages, see `estimators.parameters`."""
        ...

    def with_params(self, params: Any) -> "TunableEstimator":
        """Return the same estimator with other parameters."""
        ...

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`."""
        ...


class LabelledPhoto(NamedTuple):
    """A photo or scene of known leaf area."""

    image: RgbImage
    area_cm2: float
    info: PhotoInfo


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Accuracy of an estimator on a set of photos."""

    mre: float
    """Mean relative error in percent over the measured photos; NaN if all were refused."""
    coverage: float
    """Share of the measured photos whose error is within one standard deviation; NaN if none has one."""
    refused: int
    """Number of refused photos."""


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """Accuracy with one parameter changed."""

    parameter: Parameter
    halved: Accuracy
    doubled: Accuracy


def render_photos(
    count: int, *, seed: int, size: tuple[int, int], ranges: str = "rendering_2"
) -> list[LabelledPhoto]:
    """Render `count` scenes of different leaves at `size` (height, width) as photos of known area."""
    loaded = load_ranges(ranges)
    render = tf.function(lambda index: synthesise(seed, size=size, ranges=loaded, index=index))
    photos = []
    for number in progress_bar(range(count), desc="scenes", unit="scene"):
        scene = render(tf.constant(number * _PASSES, tf.int64))
        info = PhotoInfo(px_per_mm=float(scene["px_per_mm"]))
        photos.append(LabelledPhoto(scene["image"].numpy(), float(scene["area_cm2"]), info))
    return photos


def load_photos(photos: Sequence[Photo]) -> list[LabelledPhoto]:
    """Decode the photos of a manifest. Raises InputError for one that cannot be read."""
    return [
        LabelledPhoto(
            decode_photo(photo.image),
            photo.area_cm2,
            PhotoInfo(px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm),
        )
        for photo in progress_bar(photos, desc="photos", unit="photo")
    ]


def require_tunable(estimator: Estimator) -> TunableEstimator:
    """Return `estimator` if it has parameters. Raises InputError."""
    if not hasattr(estimator, "with_params"):
        raise InputError("an area model alone has no parameters; leave out --model")
    return cast(TunableEstimator, estimator)


def select_parameters(params: Any, prefixes: Sequence[str]) -> list[Parameter]:
    """Return the parameters whose names start with one of `prefixes`; all without any. Raises InputError."""
    parameters = list(list_parameters(params))
    unknown = [one for one in prefixes if not any(known.name.startswith(one) for known in parameters)]
    if unknown:
        stages = ", ".join(sorted({known.name.rpartition(".")[0] or known.name for known in parameters}))
        raise InputError(f"no parameter starts with {unknown[0]!r}; stages are {stages}")
    return [known for known in parameters if not prefixes or known.name.startswith(tuple(prefixes))]


def measure_accuracy(estimator: TunableEstimator, photos: Sequence[LabelledPhoto]) -> Accuracy:
    """Measure `photos` and compare with their true areas."""
    predicted, true, covered = [], [], []
    for photo in photos:
        measurement = estimator.measure(photo.image, photo.info)
        area = measurement.area_cm2
        if area is None:
            continue
        predicted.append(area)
        true.append(photo.area_cm2)
        uncertainty = measurement.uncertainty_cm2
        if uncertainty is not None:
            covered.append(abs(area - photo.area_cm2) <= uncertainty)
    coverage = float(np.mean(covered)) if covered else math.nan
    return Accuracy(mre=metrics.mre(predicted, true), coverage=coverage, refused=len(photos) - len(predicted))


def measure_sensitivity(
    estimator: TunableEstimator, photos: Sequence[LabelledPhoto], parameters: Sequence[Parameter]
) -> Iterator[Sensitivity]:
    """Yield the accuracy on `photos` with each parameter halved and doubled."""
    for parameter in progress_bar(parameters, desc="parameters", unit="parameter"):
        halved, doubled = (
            measure_accuracy(
                estimator.with_params(
                    replace_parameter(estimator.params, parameter.name, scale_value(parameter.value, factor))
                ),
                photos,
            )
            for factor in (0.5, 2.0)
        )
        yield Sensitivity(parameter=parameter, halved=halved, doubled=doubled)


def scale_value(value: Any, factor: float) -> Any:
    """Return a number, or a tuple of numbers, times `factor`; whole numbers stay whole and at least 1."""
    if isinstance(value, tuple):
        return tuple(scale_value(item, factor) for item in value)
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def to_json(base: Accuracy, results: Sequence[Sensitivity]) -> dict[str, Any]:
    """Return the results as plain values."""
    return {
        "base": asdict(base),
        "parameters": {
            result.parameter.name: {
                **result.parameter._asdict(),
                "halved": asdict(result.halved),
                "doubled": asdict(result.doubled),
            }
            for result in results
        },
    }


def format_table(base: Accuracy, results: Sequence[Sensitivity], *, count: int) -> str:
    """Return the results as text: changes of MRE, coverage and refusals, each halved / doubled."""
    names = [f"{result.parameter.name} = {_format_value(result.parameter.value)}" for result in results]
    width = max(map(len, names), default=0)
    lines = [
        f"{count} photos: MRE {base.mre:.2f} %, {100 * base.coverage:.0f} % within one standard deviation, "
        f"{base.refused} refused",
        "",
        f"{'parameter':<{width}}  change of MRE (points)  of coverage (points)  of refusals   unit",
        f"{'':<{width}}       halved / doubled      halved / doubled  halved/doubled",
    ]
    for name, result in zip(names, results, strict=True):
        changes = (result.halved, result.doubled)
        errors = " / ".join(f"{change.mre - base.mre:+8.2f}" for change in changes)
        coverages = " / ".join(f"{100 * (change.coverage - base.coverage):+7.0f}" for change in changes)
        refusals = " / ".join(f"{change.refused - base.refused:+4}" for change in changes)
        unit = f"{result.parameter.unit}; set on {result.parameter.set_on}"
        lines.append(f"{name:<{width}}    {errors}   {coverages}   {refusals}   {unit}")
    return "\n".join(lines)


def _format_value(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_format_value, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
