"""Task `mask`: segment the leaf."""

from functools import partial

import numpy as np

from laesi_tf.common import metrics
from laesi_tf.models import mask_network
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks.base import Arrays, Task


def make_mask_task(config: TrainConfig) -> Task:
    loss = mask_network.LOSSES[0] if config.loss == "auto" else config.loss
    return Task(
        build=mask_network.build_mask_network,
        loss=partial(mask_network.mask_loss, loss=loss),
        per_picture=_sample_metrics,
        figures=_aggregate,
        score="miou",
        higher_is_better=True,
    )


def _sample_metrics(output: np.ndarray, target: np.ndarray) -> dict[str, np.ndarray]:
    leaf = output[..., 0] > 0.5
    iou = metrics.ious(leaf, target)
    return {"iou": iou, "pixel_error": metrics.pixel_errors(leaf, target), "error": 1.0 - iou}


def _aggregate(found: Arrays) -> dict[str, float]:
    return {"miou": float(np.mean(found["iou"])), "mpe": float(np.nanmean(found["pixel_error"]))}
