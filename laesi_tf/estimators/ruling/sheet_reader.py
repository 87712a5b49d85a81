"""Read the ruling of a photo with the ruling network: from pixels to a camera, or to a refusal.

All that looks at pixels is TensorFlow. Only a photo whose lines are too fine for the half resolution is
looked at in full: three quarters of the network's work is there.
"""

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.arrays import Points
from laesi_tf.estimators.photo_pyramid import Crop, put_in_frame
from laesi_tf.estimators.ruling.judge import SheetReading, judge_reading
from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.estimators.ruling.reading import Reading, read_sheet
from laesi_tf.estimators.ruling.resolution import needs_full_resolution, no_answers
from laesi_tf.estimators.ruling.spectra import build_pyramid
from laesi_tf.estimators.ruling.stage import compile_stage
from laesi_tf.estimators.ruling.votes import collect_votes
from laesi_tf.models.ruling_cells import (
    CELL_PX,
    FRAME_CELLS,
    FRAME_PX,
    LEVELS,
    CellAnswers,
)
from laesi_tf.models.ruling_network import build_ruling_network, to_answers

_USED_PX = (FRAME_PX // 2, FRAME_PX * 3 // 4, FRAME_PX)
"""Sides of the part of the frame that the network sees."""


class SheetReader:
    """Reads rulings with a trained network."""

    def __init__(self, network: keras.Model, params: RulingReaderParams | None = None) -> None:
        """Take a ruling network of any input size, [B, h, w, 3] -> logits."""
        self.params = params or RulingReaderParams()
        self._keras_network = build_ruling_network()
        self._keras_network.set_weights(network.get_weights())
        self._network: Callable[..., Any] = self._keras_network
        self._ask = compile_stage(self._ask_network)

    def with_params(self, params: RulingReaderParams) -> "SheetReader":
        """Return a reader with the same network and other parameters."""
        changed = copy.copy(self)
        changed.params = params
        return changed

    def with_network(self, change: Callable[[keras.Model], Callable[..., Any]]) -> "SheetReader":
        """Return a reader whose network is replaced by what `change` makes of it, as for an export."""
        changed = copy.copy(self)
        changed._network = change(self._keras_network)
        changed._ask = compile_stage(changed._ask_network)
        return changed

    def read(self, overview: Crop, *, grid_mm: float | None) -> SheetReading:
        """Read the ruling of a photo in its `overview`, of at most FRAME_PX pixels.

        `grid_mm` is the distance of the finest lines where the user names it. The camera maps photo pixels.
        """
        height, width = overview.size
        reading: Reading = tf.nest.map_structure(
            np.asarray,
            self.read_frame(
                tf.constant(put_in_frame(overview.image)),
                tf.constant([height, width], tf.float32),
                used=(_round_up(height), _round_up(width)),
            ),
        )
        step_x, step_y = overview.pixel_size
        judged = judge_reading(
            reading,
            (height, width),
            (float(step_x), float(step_y)),
            grid_mm=grid_mm,
            params=self.params.judge,
        )
        outline = outline_sheet(reading.votes.agreement, overview, self.params.sheet_agreement)
        return replace(judged, outline=outline)

    def read_frame(
        self, frame: tf.Tensor, size: tf.Tensor, *, used: tuple[int, int] = (FRAME_PX, FRAME_PX)
    ) -> Reading:
        """Read the ruling of the photo of `size` [2] (height, width), float, in the upper left corner of a
        frame, uint8 [FRAME_PX, FRAME_PX, 3].

        The network does not see the frame beyond `used` (height, width).
        """
        pyramid = build_pyramid(tf.cast(frame[: used[0], : used[1]], tf.float32), LEVELS)

        def ask(level: int) -> CellAnswers:
            return self._ask(pyramid[level], size / 2.0**level, FRAME_CELLS >> level)

        coarse = [ask(level) for level in range(1, LEVELS)]
        params = self.params.reading
        votes = collect_votes([no_answers(), *coarse], params=params.votes)
        votes = tf.cond(
            needs_full_resolution(coarse, votes, self.params.resolution, sure=params.votes.sure),
            lambda: collect_votes([ask(0), *coarse], params=params.votes),
            lambda: votes,
        )
        return read_sheet(pyramid, size, votes, params=params)

    def _ask_network(self, image: tf.Tensor, size: tf.Tensor, cells: int) -> CellAnswers:
        """Return the answers for `image` [h, w, 3] of which the upper left `size` [2] is the photo.

        They are [cells, cells], of a whole level of the frame.
        """
        logits: Any = self._network(image[tf.newaxis], training=False)
        beyond = [[0, cells - side // CELL_PX] for side in image.shape[:2]]
        answers = to_answers(tf.pad(logits[0], [*beyond, [0, 0]]))
        middles = (tf.range(cells, dtype=tf.float32) + 0.5) * CELL_PX
        inside = (middles < size[0])[:, None] & (middles < size[1])
        return answers._replace(readable=tf.where(inside, answers.readable, 0.0))


def _round_up(side: int) -> int:
    """Return the smallest of `_USED_PX` that holds `side` pixels: few sizes, as each is compiled."""
    return next(size for size in _USED_PX if size >= side)


def outline_sheet(agreement: np.ndarray, overview: Crop, least: float) -> Points | None:
    """Return the convex outline [N, 2], photo pixels, of the cells that show the ruling; None without any.

    `agreement` [C, C] is that of `Votes`; cells with more than the `least` belong to the sheet.
    """
    rows, columns = np.nonzero(agreement > least)
    if len(rows) < 3:
        return None
    corners = np.concatenate([np.stack([columns + i, rows + j], 1) for i in (0, 1) for j in (0, 1)])
    hull = cv2.convexHull(corners.astype(np.float32) * CELL_PX)[:, 0]
    return overview.to_photo(np.minimum(hull, overview.size.xy))
