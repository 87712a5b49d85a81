"""Boxes [[left, top], [right, bottom]] around things on a photo."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Points


def square_around(box: Points, side: float) -> Points:
    """Return the square [2, 2] of `side` pixels with the centre of `box` [2, 2]."""
    middle = box.mean(axis=0)
    return np.stack([middle - side / 2, middle + side / 2])


def box_around(outline: Points, room: float) -> Points:
    """Return the box [2, 2] of `outline` [n, 2], with `room` pixels on each side."""
    return np.stack([outline.min(axis=0) - room, outline.max(axis=0) + room])


def stack_boxes(boxes: Sequence[Points]) -> NDArray[np.float64]:
    """Return `boxes`, each [2, 2], as one array [N, 2, 2]; N may be 0."""
    return np.array(boxes, np.float64).reshape(-1, 2, 2)


def largest_iou(box: Points, others: NDArray[np.float64]) -> float:
    """Return the largest intersection over union of `box` with one of `others` [N, 2, 2]; 0 without others.

    A box is [[left, top], [right, bottom]].
    """
    starts, ends = others[:, 0], others[:, 1]
    shared = np.clip(np.minimum(box[1], ends) - np.maximum(box[0], starts), 0, None).prod(axis=1)
    union = (box[1] - box[0]).prod() + (ends - starts).prod(axis=1) - shared
    return float((shared / union).max(initial=0.0))
