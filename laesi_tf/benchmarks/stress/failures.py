"""The first picture of each nuisance that the first method gets wrong without a word."""

from collections.abc import Mapping, Sequence

from laesi_tf.benchmarks.stress.nuisances import Nuisance
from laesi_tf.benchmarks.stress.sources import Source
from laesi_tf.benchmarks.stress.trials import Trial, measure_photo
from laesi_tf.estimators.base import Estimator
from laesi_tf.reporting.measurement_overlay import draw_comparison
from laesi_tf.reporting.stress_page import Failure

_SIDE_PX = 320


def draw_first_failures(
    trials: Sequence[Trial],
    sources: Mapping[str, Source],
    nuisances: Sequence[Nuisance],
    estimators: Mapping[str, Estimator],
    *,
    limit: int,
) -> list[Failure]:
    """Draw the failures of the first of `estimators`: of each nuisance and set, the largest error at the
    least severity that has any; at most `limit` of them."""
    method = next(iter(estimators))
    known = {nuisance.name: nuisance for nuisance in nuisances}
    first: dict[tuple[str, str], Trial] = {}
    for trial in trials:
        if trial.method == method and trial.is_silent_error:
            best = first.get((trial.nuisance, trial.set))
            if best is None or (trial.step, -abs(trial.error or 0)) < (best.step, -abs(best.error or 0)):
                first[trial.nuisance, trial.set] = trial
    return [
        _draw(trial, sources[trial.set], known[trial.nuisance], estimators[method])
        for trial in list(first.values())[:limit]
    ]


def _draw(trial: Trial, source: Source, nuisance: Nuisance, estimator: Estimator) -> Failure:
    photo = source.make(trial.picture, nuisance, trial.step)
    measured = measure_photo(estimator, photo)
    image = draw_comparison(photo.image, measured, photo.mask, side=_SIDE_PX)
    note = f", noted: {measured.note}" if measured.note else ""
    caption = (
        f"{nuisance.name} {nuisance.label(trial.step)} {nuisance.unit}, {trial.set}: "
        f"{trial.predicted_cm2:.2f} for {trial.true_cm2:.2f} cm² ({100 * (trial.error or 0):+.0f} %){note}"
    )
    return Failure(image, caption)
