"""What differs between the tasks that a network is trained for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import keras
import numpy as np
import tensorflow as tf

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
