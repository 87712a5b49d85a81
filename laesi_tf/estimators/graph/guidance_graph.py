"""What is missing while a user aims a camera: a small graph that looks at preview images several times a
second."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.estimators.graph.guidance_measures import (
    CELLS,
    VIEW_PX,
    draw_border,
    is_inside,
    make_filter,
    measure_evenness,
    measure_one_sidedness,
    measure_share_on,
    measure_share_seen,
    measure_sharpness,
    measure_tilt,
)
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.ruling.verdict import choose_first
from laesi_tf.models.inference import freeze_network
from laesi_tf.models.ruling_cells import FINEST_PX, FRAME_PX, LOG_STEP
from laesi_tf.models.ruling_network import build_ruling_network, split_heads, to_answers

_COARSEST_PX = 30.0
"""Distance of lines that the network reads well."""
_LUMINANCE = (0.299, 0.587, 0.114)


class Hint(IntEnum):
    """What to change; the numbers stand in exported files and are never reused. The first that applies is
    shown."""

    READY = 0
    TOO_DARK = 1
    NO_RULING = 2
    BLURRED = 3
    MOVE_CLOSER = 4
    TOO_TILTED = 5
    NO_LEAF = 6
    LEAF_CUT_OFF = 7
    LEAF_OFF_PAPER = 8
    SHADOW = 9


_SET_ON = "semi-real's train and drawn previews, 2026-11-29"


@dataclass(frozen=True, kw_only=True)
class GuidanceParams:
    """Thresholds of the hints."""

    readable: float = parameter(0.5, unit="probability", set_on=_SET_ON)
    """A cell with more shows a ruling."""
    fewest_cells: int = parameter(12, unit="cells", set_on="JudgeParams.fewest_cells")
    """Of the whole view, or of the parts, that show a ruling."""
    darkest: float = parameter(50.0, unit="grey level", set_on=_SET_ON)
    """Mean of a view that is bright enough."""
    blurred: float = parameter(0.035, unit="share of the power", set_on=_SET_ON)
    """Of detail finer than 9 pixels, what is finer than 3 pixels: less is blurred."""
    shaken: float = parameter(0.45, unit="coherence", set_on=_SET_ON)
    """Edges that run so far in one direction are those of a ruling that was shaken."""
    unseen: float = parameter(0.3, unit="share of the cells", set_on=_SET_ON)
    """Of parts where the whole view shows a ruling: if fewer cells show it, it is blurred or shaken."""
    finest_px: float = parameter(2.5, unit="frame pixels", set_on="the guide to photos, 2026-11-29")
    """Distance of lines that can be read in the photo."""
    most_hidden: float = parameter(0.58, unit="share of the cells", set_on=_SET_ON)
    """Cells that may hide finer lines, at most."""
    steepest_deg: float = parameter(19.0, unit="degrees", set_on=_SET_ON)
    """Tilt of the paper as it is seen here: 35 degrees are often seen as 20 to 25."""
    smallest_leaf: float = parameter(0.003, unit="share of the view", set_on=_SET_ON)
    """Area of what is taken for a leaf."""
    border_px: int = parameter(3, unit="network pixels", set_on=_SET_ON)
    """So many pixels of leaf on the view's border cut it off."""
    sheet_cells: int = parameter(48, unit="cells", set_on=_SET_ON)
    """Cells of the whole view that must show a ruling to say what lies beside it."""
    on_sheet: float = parameter(0.5, unit="share of the leaf", set_on="RulingEstimatorParams.on_sheet")
    """Of the leaf, what lies within the ruled cells."""
    deepest_shadow: float = parameter(0.5, unit="ratio of grey levels", set_on=_SET_ON)
    """Of the darkest tenth of the ruled cells to the brightest."""


class Ruling(NamedTuple):
    """What is seen of the ruling; scalars."""

    cells: tf.Tensor
    """Cells that show it, the larger number of both views."""
    seen: tf.Tensor
    """Share of the cells that show it in parts where the whole view does; 1 without such parts."""
    period_px: tf.Tensor
    """Distance of the finest lines that are seen, frame pixels."""
    hidden: tf.Tensor
    """Share of the cells that may hide finer lines."""
    tilt_deg: tf.Tensor


class GuidanceGraph(tf.Module):
    """Says what is missing in preview images with a mask and a ruling network."""

    def __init__(
        self,
        mask_network: keras.Model,
        ruling_network: keras.Model,
        params: GuidanceParams | None = None,
    ) -> None:
        """Take a mask network of a square input and a ruling network of any input."""
        super().__init__(name="guidance_graph")
        self.params = params or GuidanceParams()
        self._side = mask_network.input_shape[1]
        self._mask_network = freeze_network(mask_network)
        fixed = build_ruling_network(VIEW_PX, VIEW_PX)
        fixed.set_weights(ruling_network.get_weights())
        self._ruling_network = freeze_network(fixed)

    @tf.function(
        autograph=False,
        input_signature=[
            tf.TensorSpec([VIEW_PX, VIEW_PX, 3], tf.uint8, "view"),
            tf.TensorSpec([2], tf.int32, "size"),
            tf.TensorSpec([VIEW_PX, VIEW_PX, 3], tf.uint8, "parts"),
            tf.TensorSpec([], tf.float32, "frame_px"),
        ],
    )
    def guide(
        self, view: tf.Tensor, size: tf.Tensor, parts: tf.Tensor, frame_px: tf.Tensor
    ) -> dict[str, tf.Tensor]:
        """Return the hint for a preview image, and the measures that it follows from.

        `view` is the whole image, shrunk to a longer side of VIEW_PX, in the upper left corner; `size` its
        (height, width) there. `parts` are four squares of the image at its own resolution, of which a pixel
        is `frame_px` pixels of the frame wide that the photo will be measured in.
        """
        params = self.params
        pictures = tf.cast(tf.stack([view, parts]), tf.float32)
        extent = tf.cast(size, tf.float32)
        logits = self._ruling_network(pictures)
        whole = tf.sigmoid(split_heads(logits[0])["readable"]) > params.readable
        ruled = tf.cast(whole & is_inside(CELLS, extent / VIEW_PX), tf.float32)
        ruling = self._read(logits, ruled, extent, frame_px)
        luminance = tf.reduce_sum(pictures * np.array(_LUMINANCE, np.float32), -1)
        inside = tf.cast(is_inside(VIEW_PX, extent / VIEW_PX), tf.float32)
        brightness = tf.reduce_sum(luminance[0] * inside) / tf.maximum(tf.reduce_sum(inside), 1.0)
        sharpness = measure_sharpness(luminance[1])
        leaf = self._find_leaf(pictures[0], inside)
        shown = tf.cast(is_inside(self._side, extent / VIEW_PX), tf.float32)
        leaf *= shown
        share = tf.reduce_sum(leaf) / tf.maximum(tf.reduce_sum(shown), 1.0)
        on_border = tf.reduce_sum(leaf * draw_border(shown))
        shadow = measure_evenness(luminance[0], ruled)
        on_sheet = measure_share_on(leaf, ruled)
        # A ruling that is too fine for the whole view shows in the parts alone.
        shows_sheet = tf.reduce_sum(ruled) >= params.sheet_cells
        is_unread = ruling.cells < params.fewest_cells
        one_sidedness = measure_one_sidedness(luminance[1])
        is_blurred = (sharpness < params.blurred) | (ruling.seen < params.unseen)
        is_blurred |= one_sidedness > params.shaken
        reasons = [
            (brightness < params.darkest, Hint.TOO_DARK),
            (is_unread, Hint.NO_RULING),
            (is_blurred, Hint.BLURRED),
            (
                (ruling.period_px < params.finest_px) | (ruling.hidden > params.most_hidden),
                Hint.MOVE_CLOSER,
            ),
            (ruling.tilt_deg > params.steepest_deg, Hint.TOO_TILTED),
            (share < params.smallest_leaf, Hint.NO_LEAF),
            (on_border >= params.border_px, Hint.LEAF_CUT_OFF),
            (shows_sheet & (on_sheet < params.on_sheet), Hint.LEAF_OFF_PAPER),
            (shadow < params.deepest_shadow, Hint.SHADOW),
        ]
        return {
            "hint": choose_first(reasons, Hint.READY),
            "brightness": brightness,
            "sharpness": sharpness,
            "one_sidedness": one_sidedness,
            "cells": ruling.cells,
            "seen": ruling.seen,
            "period_px": ruling.period_px,
            "hidden": ruling.hidden,
            "tilt_deg": ruling.tilt_deg,
            "leaf_share": share,
            "on_border": on_border,
            "on_sheet": on_sheet,
            "evenness": shadow,
        }

    def _read(self, logits: tf.Tensor, ruled: tf.Tensor, extent: tf.Tensor, frame_px: tf.Tensor) -> Ruling:
        """Read `logits` [2, C, C, CHANNELS] of the whole view, of `extent` [2], and of its parts."""
        close = to_answers(logits[1])
        clear = tf.cast(close.readable > self.params.readable, tf.float32)
        count = tf.reduce_sum(clear)
        votes = tf.reduce_sum(clear[..., None] * close.periods, [0, 1])
        period = _to_period(tf.argmax(votes)) * frame_px
        is_seen = count >= self.params.fewest_cells
        of_view = tf.nn.softmax(split_heads(logits[0])["periods"])
        best_of_view = tf.argmax(tf.reduce_sum(ruled[..., None] * of_view, [0, 1]))
        # Lines that are further apart than the network reads leave the parts without any.
        in_parts = _to_period(best_of_view) * (FRAME_PX / VIEW_PX) / frame_px
        is_coarse = in_parts > _COARSEST_PX
        return Ruling(
            cells=tf.maximum(count, tf.reduce_sum(ruled)),
            # Without a part that shows lines, nothing is known of the finest.
            period_px=tf.where(is_seen, period, self.params.finest_px),
            hidden=tf.reduce_sum(clear * close.finest_uncertain) / tf.maximum(count, 1.0),
            seen=tf.where(is_coarse, 1.0, measure_share_seen(ruled, clear, extent)),
            # The heaviest lines are far enough apart in the whole view.
            tilt_deg=measure_tilt(tf.nn.softmax(split_heads(logits[0])["heaviest"]), ruled),
        )

    def _find_leaf(self, picture: tf.Tensor, inside: tf.Tensor) -> tf.Tensor:
        """Return the mask, float [s, s] of 0 and 1, of a picture, [VIEW_PX, VIEW_PX, 3] of 0..255."""
        # Beyond the view there is more of the same, rather than black.
        mean = tf.reduce_sum(picture * inside[..., None], [0, 1]) / tf.maximum(tf.reduce_sum(inside), 1.0)
        filled = tf.where(inside[..., None] > 0, picture, mean)
        shrink = tf.constant(make_filter(VIEW_PX, self._side))
        rows = tf.matmul(shrink, tf.reshape(filled, [VIEW_PX, VIEW_PX * 3]))
        turned = tf.transpose(tf.reshape(rows, [self._side, VIEW_PX, 3]), [1, 0, 2])
        both = tf.matmul(shrink, tf.reshape(turned, [VIEW_PX, self._side * 3]))
        small = tf.transpose(tf.reshape(both, [self._side, self._side, 3]), [1, 0, 2])
        probability = self._mask_network(small[tf.newaxis])[0, ..., 0]
        return tf.cast(probability >= 0.5, tf.float32)


def _to_period(index: tf.Tensor) -> tf.Tensor:
    """Return the pixels per period at the middle of a bin, an integer scalar."""
    return FINEST_PX * tf.exp(LOG_STEP * (tf.cast(index, tf.float32) + 0.5))
