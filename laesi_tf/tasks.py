"""The two things a network learns here, area and mask, behind one face: there is one training loop."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import keras
import numpy as np
import tensorflow as tf

from laesi_tf import metrics
from laesi_tf.config import TrainConfig
from laesi_tf.models import area_network, mask_network

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Task:
    """How to build, train and judge a network.

    Targets are those of `laesi_tf.data.synthetic.batches`. `per_picture` turns a batch of outputs and targets
    into arrays [B]; `figures` turns such arrays over a whole set into the figures of merit;
    `score` is the figure that picks the best model, `error` the array that ranks pictures from good to bad.
    """

    build: Callable[[keras.Model], keras.Model]
    loss: Callable[[tf.Tensor, tf.Tensor], tf.Tensor]
    per_picture: Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]
    figures: Callable[[Arrays], dict[str, float]]
    score: str
    higher_is_better: bool

    def merit(self, figures: Mapping[str, float]) -> float:
        """The score, turned so that higher is better."""
        return figures[self.score] if self.higher_is_better else -figures[self.score]


def task(config: TrainConfig) -> Task:
    """The task a configuration names, with its loss."""
    return _area(config) if config.task == "area" else _mask(config)


def _area(config: TrainConfig) -> Task:
    loss = area_network.LOSSES[0] if config.loss == "auto" else config.loss
    return Task(
        build=partial(area_network.build_area_network, transform=config.transform),
        loss=partial(area_network.area_loss, transform=config.transform, loss=loss),
        per_picture=partial(_areas, transform=config.transform),
        figures=_area_figures,
        score="mre",
        higher_is_better=False,
    )


def _mask(config: TrainConfig) -> Task:
    loss = mask_network.LOSSES[0] if config.loss == "auto" else config.loss
    return Task(
        build=mask_network.build_mask_network,
        loss=partial(mask_network.mask_loss, loss=loss),
        per_picture=_overlaps,
        figures=_mask_figures,
        score="miou",
        higher_is_better=True,
    )


def _areas(output: np.ndarray, target: np.ndarray, *, transform: str) -> dict[str, np.ndarray]:
    predicted, true = area_network.to_area_cm2(output[:, 0], transform), target[:, 0]
    return {"predicted": predicted, "true": true, "error": metrics.relative_errors(predicted, true)}


def _area_figures(found: Arrays) -> dict[str, float]:
    pair = found["predicted"], found["true"]
    return {"mre": metrics.mre(*pair), "median": metrics.median(*pair), "p90": metrics.p90(*pair)}


def _overlaps(output: np.ndarray, target: np.ndarray) -> dict[str, np.ndarray]:
    leaf = output[..., 0] > 0.5
    iou = metrics.ious(leaf, target)
    return {"iou": iou, "pixel_error": metrics.pixel_errors(leaf, target), "error": 1.0 - iou}


def _mask_figures(found: Arrays) -> dict[str, float]:
    return {"miou": float(np.mean(found["iou"])), "mpe": float(np.nanmean(found["pixel_error"]))}
