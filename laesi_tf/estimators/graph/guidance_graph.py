"""What is missing while a user aims a camera: a small graph that looks at preview images several times a
second."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import FOCAL
from laesi_tf.estimators.graph.components import find_ends
from laesi_tf.estimators.parameters import parameter
from laesi_tf.models.inference import freeze_network
from laesi_tf.models.ruling_cells import CELL_PX, FINEST_PX, FRAME_PX, LOG_STEP, PERIOD_BINS
from laesi_tf.models.ruling_network import build_ruling_network, split_heads, to_answers

VIEW_PX = 384
"""Side of both inputs."""
TILE_PX = VIEW_PX // 2
"""Side of the four parts of the preview that the second input shows at its own resolution."""
_CELLS = VIEW_PX // CELL_PX
_DIRECTIONS = 16
_BLOCK = 8
"""Side in network pixels of the blocks of leaf that are compared with the ruled cells."""
PART_PLACES = 0.2, 0.8
"""Middles of the parts in units of the preview's height and width."""
_FAINTEST = 3.0
"""Variance of detail in squared grey levels: less is noise on even paper."""
_APART = 4
"""Cells between those whose distances of lines are compared for the tilt."""
_LARGEST_CHANGE = 4.5
"""Bins by which these may differ: two levels of lines differ by eight at least."""
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
        ruled = tf.cast(whole & _is_inside(_CELLS, extent / VIEW_PX), tf.float32)
        ruling = self._read(logits, ruled, extent, frame_px)
        luminance = tf.reduce_sum(pictures * np.array(_LUMINANCE, np.float32), -1)
        inside = tf.cast(_is_inside(VIEW_PX, extent / VIEW_PX), tf.float32)
        brightness = tf.reduce_sum(luminance[0] * inside) / tf.maximum(tf.reduce_sum(inside), 1.0)
        sharpness = measure_sharpness(luminance[1])
        leaf = self._find_leaf(pictures[0], inside)
        shown = tf.cast(_is_inside(self._side, extent / VIEW_PX), tf.float32)
        leaf *= shown
        share = tf.reduce_sum(leaf) / tf.maximum(tf.reduce_sum(shown), 1.0)
        on_border = tf.reduce_sum(leaf * _draw_border(shown))
        shadow = measure_evenness(luminance[0], ruled)
        on_sheet = _measure_share_on(leaf, ruled)
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
        hint = tf.constant(Hint.READY, tf.int32)
        for applies, reason in reversed(reasons):
            hint = tf.where(applies, tf.constant(reason, tf.int32), hint)
        return {
            "hint": hint,
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
            seen=tf.where(is_coarse, 1.0, _measure_share_seen(ruled, clear, extent)),
            # The heaviest lines are far enough apart in the whole view.
            tilt_deg=measure_tilt(tf.nn.softmax(split_heads(logits[0])["heaviest"]), ruled),
        )

    def _find_leaf(self, picture: tf.Tensor, inside: tf.Tensor) -> tf.Tensor:
        """Return the mask, float [s, s] of 0 and 1, of a picture, [VIEW_PX, VIEW_PX, 3] of 0..255."""
        # Beyond the view there is more of the same, rather than black.
        mean = tf.reduce_sum(picture * inside[..., None], [0, 1]) / tf.maximum(tf.reduce_sum(inside), 1.0)
        filled = tf.where(inside[..., None] > 0, picture, mean)
        shrink = tf.constant(_make_filter(VIEW_PX, self._side))
        rows = tf.matmul(shrink, tf.reshape(filled, [VIEW_PX, VIEW_PX * 3]))
        turned = tf.transpose(tf.reshape(rows, [self._side, VIEW_PX, 3]), [1, 0, 2])
        both = tf.matmul(shrink, tf.reshape(turned, [VIEW_PX, self._side * 3]))
        small = tf.transpose(tf.reshape(both, [self._side, self._side, 3]), [1, 0, 2])
        probability = self._mask_network(small[tf.newaxis])[0, ..., 0]
        return tf.cast(probability >= 0.5, tf.float32)


def _to_period(index: tf.Tensor) -> tf.Tensor:
    """Return the pixels per period at the middle of a bin, an integer scalar."""
    return FINEST_PX * tf.exp(LOG_STEP * (tf.cast(index, tf.float32) + 0.5))


def measure_tilt(periods: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
    """Return the paper's tilt in degrees, by how the distance of lines changes over the view.

    `periods` [C, C, PERIOD_BINS] are probabilities, `ruled` [C, C] the cells that count. Distances fall with
    the power 1.5 of the depth: once across the tilt, twice along it.
    """
    bins = np.arange(PERIOD_BINS, dtype=np.float32)
    best = tf.cast(tf.argmax(periods, -1), tf.float32)
    near = tf.maximum(0.0, 1 - tf.abs(bins - best[..., None]) / 3) * periods
    places = tf.reduce_sum(near * bins, -1) / tf.maximum(tf.reduce_sum(near, -1), 1e-6)

    def measure_slope(places: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
        """Return the mean change of ln of the distance from top to bottom of a view as high as wide."""
        change = places[_APART:] - places[:-_APART]
        # Larger ones are from lines of one level to those of another.
        counts = ruled[_APART:] * ruled[:-_APART] * tf.cast(tf.abs(change) < _LARGEST_CHANGE, tf.float32)
        total = tf.reduce_sum(counts)
        mean = tf.reduce_sum(counts * change) / tf.maximum(total, 1.0)
        return tf.where(total < _CELLS, 0.0, mean * (LOG_STEP * _CELLS / _APART))

    down = measure_slope(places, ruled)
    across = measure_slope(tf.transpose(places), tf.transpose(ruled))
    slope = tf.sqrt(down**2 + across**2)
    return tf.atan2(FOCAL * slope / 1.5, tf.ones_like(slope)) * (180 / math.pi)


def _measure_share_seen(ruled: tf.Tensor, clear: tf.Tensor, extent: tf.Tensor) -> tf.Tensor:
    """Return the share of the cells of parts that are `clear` [C, C], where `ruled` [C, C] says that the
    whole view shows lines at the part's middle; 1 without such parts."""
    around = tf.nn.avg_pool2d(ruled[tf.newaxis, ..., tf.newaxis], 3, 1, "SAME")[0, ..., 0]
    of_parts = tf.nn.avg_pool2d(clear[tf.newaxis, ..., tf.newaxis], _CELLS // 2, _CELLS // 2, "VALID")[
        0, ..., 0
    ]
    rows, columns = (
        tf.minimum(tf.cast(extent[axis] / CELL_PX * np.array(PART_PLACES, np.float32), tf.int32), _CELLS - 1)
        for axis in (0, 1)
    )
    shows = tf.cast(tf.gather(tf.gather(around, rows), columns, axis=1) > 0.5, tf.float32)
    count = tf.reduce_sum(shows)
    return tf.where(count > 0, tf.reduce_sum(shows * of_parts) / tf.maximum(count, 1.0), 1.0)


def measure_sharpness(luminance: tf.Tensor) -> tf.Tensor:
    """Return the share of the power of fine detail that is finer still, of four parts [VIEW_PX, VIEW_PX];
    0 where there is no detail."""
    tiles = _split_parts(luminance)

    def remove_mean(side: int) -> tf.Tensor:
        rest = tiles - tf.nn.avg_pool2d(tiles, side, 1, "SAME")
        return rest[:, 8:-8, 8:-8]

    powers = [tf.reduce_mean(remove_mean(side) ** 2, [1, 2, 3]) for side in (3, 9)]
    # The sharpest part: paper may lie in one of them alone. Nearly even parts show noise.
    shares = tf.where(powers[1] > _FAINTEST, powers[0] / tf.maximum(powers[1], 1e-6), 0.0)
    return tf.reduce_max(shares)


def measure_one_sidedness(luminance: tf.Tensor) -> tf.Tensor:
    """Return how far the edges in four parts [VIEW_PX, VIEW_PX] run in one direction: 0 both, 1 one alone.

    It is that of the part with the most directions, the coherence of its structure tensor. A camera that
    moves blurs one of two crossing families of lines.
    """
    tiles = _split_parts(luminance)
    across = tiles[:, 1:-1, 2:] - tiles[:, 1:-1, :-2]
    down = tiles[:, 2:, 1:-1] - tiles[:, :-2, 1:-1]
    xx, xy, yy = (
        tf.reduce_mean(one * other, [1, 2, 3])
        for one, other in ((across, across), (across, down), (down, down))
    )
    coherence = tf.sqrt((xx - yy) ** 2 + 4 * xy**2) / tf.maximum(xx + yy, 1e-6)
    return tf.reduce_min(tf.where(xx + yy > _FAINTEST, coherence, 1.0))


def _split_parts(luminance: tf.Tensor) -> tf.Tensor:
    """Return the parts, [4, TILE_PX, TILE_PX, 1], of a picture [VIEW_PX, VIEW_PX] of four."""
    tiles = tf.reshape(luminance, [2, TILE_PX, 2, TILE_PX])
    return tf.reshape(tf.transpose(tiles, [0, 2, 1, 3]), [4, TILE_PX, TILE_PX, 1])


def measure_evenness(luminance: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
    """Return the ratio of the darkest to the brightest tenth of the cells `ruled` [C, C]."""
    grey = tf.nn.avg_pool2d(luminance[tf.newaxis, ..., tf.newaxis], CELL_PX, CELL_PX, "VALID")[0, ..., 0]
    order = tf.sort(tf.reshape(tf.where(ruled > 0, grey, 1e9), [-1]))
    count = tf.reduce_sum(ruled)
    low = tf.gather(order, tf.cast(count * 0.1, tf.int32))
    high = tf.gather(order, tf.cast(tf.maximum(count * 0.9 - 1, 0.0), tf.int32))
    return tf.where(count > 0, low / tf.maximum(high, 1.0), 1.0)


def _measure_share_on(leaf: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
    """Return the share of `leaf` [s, s] within the convex outline of the cells `ruled` [C, C]."""
    blocks = tf.nn.avg_pool2d(leaf[tf.newaxis, ..., tf.newaxis], _BLOCK, _BLOCK, "VALID")[0, ..., 0]
    side, turns = blocks.shape[0], 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across, down = np.cos(turns).astype(np.float32), np.sin(turns).astype(np.float32)
    first, last = find_ends(ruled)
    rows = np.arange(_CELLS, dtype=np.float32)
    reach = tf.maximum(first[:, None] * across, last[:, None] * across)
    reach += np.maximum(rows[:, None] * down, (rows[:, None] + 1) * down)
    limits = tf.reduce_max(tf.where(last[:, None] > 0, reach, -1e9), 0)
    places = (np.arange(side, dtype=np.float32) + 0.5) * (_CELLS / side)
    x, y = np.meshgrid(places, places)
    points = np.stack([x.ravel(), y.ravel()], 1)
    beyond = tf.reduce_max(points @ np.stack([across, down]) - limits, -1)
    inside = tf.cast(beyond <= 0, tf.float32) * tf.reshape(blocks, [-1])
    return tf.reduce_sum(inside) / tf.maximum(tf.reduce_sum(blocks), 1e-6)


def _is_inside(side: int, share: tf.Tensor) -> tf.Tensor:
    """Return where the middles of the pixels of a square lie in its upper left `share` [2], bool [s, s]."""
    middles = (np.arange(side, dtype=np.float32) + 0.5) / side
    return (middles < share[0])[:, None] & (middles < share[1])


def _draw_border(shown: tf.Tensor) -> tf.Tensor:
    """Return the outermost two pixels of the rectangle of ones in `shown` [s, s]."""
    padded = tf.pad(shown, [[2, 2], [2, 2]])
    inner = -tf.nn.max_pool2d(-padded[tf.newaxis, ..., tf.newaxis], 5, 1, "VALID")[0, ..., 0]
    return shown - inner


def _make_filter(size: int, target: int) -> np.ndarray:
    """Return the matrix [target, size] of an antialiased triangle filter."""
    scale = size / target
    centres = (np.arange(target)[:, None] + 0.5) * scale
    weights = np.maximum(0.0, 1 - np.abs(np.arange(size) + 0.5 - centres) / scale)
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)
