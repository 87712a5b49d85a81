"""What a preview image says about its ruling, sharpness, light and leaf: plain functions of tensors."""

import math

import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import FOCAL
from laesi_tf.estimators.graph.components import find_ends
from laesi_tf.models.ruling_cells import CELL_PX, LOG_STEP, PERIOD_BINS

VIEW_PX = 384
"""Side of both inputs."""
TILE_PX = VIEW_PX // 2
"""Side of the four parts of the preview that the second input shows at its own resolution."""
CELLS = VIEW_PX // CELL_PX
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
        return tf.where(total < CELLS, 0.0, mean * (LOG_STEP * CELLS / _APART))

    down = measure_slope(places, ruled)
    across = measure_slope(tf.transpose(places), tf.transpose(ruled))
    slope = tf.sqrt(down**2 + across**2)
    return tf.atan2(FOCAL * slope / 1.5, tf.ones_like(slope)) * (180 / math.pi)


def measure_share_seen(ruled: tf.Tensor, clear: tf.Tensor, extent: tf.Tensor) -> tf.Tensor:
    """Return the share of the cells of parts that are `clear` [C, C], where `ruled` [C, C] says that the
    whole view shows lines at the part's middle; 1 without such parts."""
    around = tf.nn.avg_pool2d(ruled[tf.newaxis, ..., tf.newaxis], 3, 1, "SAME")[0, ..., 0]
    of_parts = tf.nn.avg_pool2d(clear[tf.newaxis, ..., tf.newaxis], CELLS // 2, CELLS // 2, "VALID")[
        0, ..., 0
    ]
    rows, columns = (
        tf.minimum(tf.cast(extent[axis] / CELL_PX * np.array(PART_PLACES, np.float32), tf.int32), CELLS - 1)
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


def measure_share_on(leaf: tf.Tensor, ruled: tf.Tensor) -> tf.Tensor:
    """Return the share of `leaf` [s, s] within the convex outline of the cells `ruled` [C, C]."""
    blocks = tf.nn.avg_pool2d(leaf[tf.newaxis, ..., tf.newaxis], _BLOCK, _BLOCK, "VALID")[0, ..., 0]
    side, turns = blocks.shape[0], 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across, down = np.cos(turns).astype(np.float32), np.sin(turns).astype(np.float32)
    first, last = find_ends(ruled)
    rows = np.arange(CELLS, dtype=np.float32)
    reach = tf.maximum(first[:, None] * across, last[:, None] * across)
    reach += np.maximum(rows[:, None] * down, (rows[:, None] + 1) * down)
    limits = tf.reduce_max(tf.where(last[:, None] > 0, reach, -1e9), 0)
    places = (np.arange(side, dtype=np.float32) + 0.5) * (CELLS / side)
    x, y = np.meshgrid(places, places)
    points = np.stack([x.ravel(), y.ravel()], 1)
    beyond = tf.reduce_max(points @ np.stack([across, down]) - limits, -1)
    inside = tf.cast(beyond <= 0, tf.float32) * tf.reshape(blocks, [-1])
    return tf.reduce_sum(inside) / tf.maximum(tf.reduce_sum(blocks), 1e-6)


def is_inside(side: int, share: tf.Tensor) -> tf.Tensor:
    """Return where the middles of the pixels of a square lie in its upper left `share` [2], bool [s, s]."""
    middles = (np.arange(side, dtype=np.float32) + 0.5) / side
    return (middles < share[0])[:, None] & (middles < share[1])


def draw_border(shown: tf.Tensor) -> tf.Tensor:
    """Return the outermost two pixels of the rectangle of ones in `shown` [s, s]."""
    padded = tf.pad(shown, [[2, 2], [2, 2]])
    inner = -tf.nn.max_pool2d(-padded[tf.newaxis, ..., tf.newaxis], 5, 1, "VALID")[0, ..., 0]
    return shown - inner


def make_filter(size: int, target: int) -> np.ndarray:
    """Return the matrix [target, size] of an antialiased triangle filter."""
    scale = size / target
    centres = (np.arange(target)[:, None] + 0.5) * scale
    weights = np.maximum(0.0, 1 - np.abs(np.arange(size) + 0.5 - centres) / scale)
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)
