"""Task `area`: regress the leaf area in cm2."""

from functools import partial

import numpy as np

from laesi_tf.common import metrics
from laesi_tf.models import area_network
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks.base import Arrays, Task


def make_area_task(config: TrainConfig) -> Task:
    loss = area_network.LOSSES[0] if config.loss == "auto" else config.loss
    return Task(
        build=partial(area_network.build_area_network, transform=config.transform),
        loss=partial(area_network.area_loss, transform=config.transform, loss=loss),
        per_picture=partial(_sample_metrics, transform=config.transform),
        figures=_aggregate,
        score="mre",
        higher_is_better=False,
    )


def _sample_metrics(output: np.ndarray, target: np.ndarray, *, transform: str) -> dict[str, np.ndarray]:
    predicted, true = area_network.to_area_cm2(output[:, 0], transform), target[:, 0]
    return {"predicted": predicted, "true": true, "error": metrics.relative_errors(predicted, true)}


def _aggregate(found: Arrays) -> dict[str, float]:
    pair = found["predicted"], found["true"]
    return {
        "mre": metrics.mre(*pair),
        "median": metrics.median_relative_error(*pair),
        "p90": metrics.p90_relative_error(*pair),
    }
