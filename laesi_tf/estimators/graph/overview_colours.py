"""The colours of a photo at the network's resolution, inside a graph: CIELAB, absolute and relative to the
sheet, and where leaves and things of their colour lie.

The rules and their thresholds are those of `estimators.leaf_colour`, at half its resolution.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.graph.close_looks import MAX_LEAVES, Found
from laesi_tf.estimators.graph.components import MOST, find_components, grow_mask
from laesi_tf.estimators.graph.crops import Square, cut_square, fit_square, show_square
from laesi_tf.estimators.leaf_colour import LeafColourParams

_CELL = 8
"""Side in pixels of the cells whose mean colours the sheet's colour is the median of."""
_NEAR_PX = 2
"""What is so near to a leaf belongs to it."""


class Overview(NamedTuple):
    """A whole photo in a square of the network's size s."""

    image: tf.Tensor
    """[s, s, 3], 0..255."""
    square: Square
    shown: tf.Tensor
    """[s, s], 1 where the photo is."""


class Things(NamedTuple):
    """What has a leaf's colour, at most MOST things, in falling order."""

    found: Found
    """As if each were a leaf in the crop of the whole photo; area 0 where there is none."""
    colours: tf.Tensor
    """[MOST, 3], mean CIELAB relative to the sheet."""
    near_found: tf.Tensor
    """[MOST], share that lies on leaves that were found."""
    lab: tf.Tensor
    """[s, s, 3], CIELAB of the overview relative to the sheet."""


def make_overview(levels: list[tf.Tensor], size: tf.Tensor, side: int) -> Overview:
    """Return the photo of `size` [2] in a frame with `levels`."""
    whole = tf.concat([[0.0, 0.0], tf.reverse(size, [0])], 0)
    square = fit_square(whole, size)
    return Overview(cut_square(levels, square, side), square, show_square(square, side))


def paint_leaves(overview: Overview, found: Found, counts: tf.Tensor) -> tf.Tensor:
    """Return 1, [L, s, s], where each of the leaves that `counts` [L] lies in the overview."""
    side = found.leaf.shape[1]
    centres = (np.arange(side, dtype=np.float32) + 0.5) / side * overview.square.side

    def paint(turn: tf.Tensor, painted: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        left, top, wide = tf.unstack(tf.gather(found.square, turn))
        leaf = tf.cast(tf.gather(found.leaf, turn) >= 0.5, tf.float32)
        for axis, (low, start) in enumerate(((overview.square.top, top), (overview.square.left, left))):
            place = (low + centres - start) / tf.maximum(wide, 1e-3) * side
            inside = tf.cast((place >= 0) & (place < side), tf.float32)
            nearest = tf.cast(tf.clip_by_value(place, 0.0, side - 1.0), tf.int32)
            leaf = tf.gather(leaf, nearest, axis=axis) * (inside[:, None] if axis == 0 else inside)
        counted = tf.one_hot(turn, MAX_LEAVES) * tf.cast(counts, tf.float32)
        return turn + 1, painted + counted[:, None, None] * leaf

    number = tf.reduce_sum(tf.cast(found.area > 0, tf.int32))
    # Not a constant, which would be stored with all its zeros.
    nothing = tf.fill(found.leaf.shape, tf.cast(overview.square.side < 0, tf.float32))
    start = (tf.constant(0), nothing)
    return tf.while_loop(lambda turn, _: turn < number, paint, start, maximum_iterations=MAX_LEAVES)[1]


def find_things(overview: Overview, painted: tf.Tensor, params: LeafColourParams) -> Things:
    """Return what has a leaf's colour, beside leaves `painted` [L, s, s] that were found, see
    `leaf_colour.find_leaf_colour`."""
    image, square, shown = overview
    side = image.shape[0]
    scale = side / params.side_px
    near = grow_mask(tf.reduce_max(painted, 0), _NEAR_PX)
    relative = image / tf.maximum(_estimate_sheet(image, shown * (1 - near), params.sheet_window), 1.0)
    lab = to_lab(relative / tf.maximum(tf.reduce_max(relative, -1, keepdims=True), 1.0))
    hue = tf.atan2(lab[..., 2], lab[..., 1]) * (180 / np.pi)
    low, high = params.hues
    saturation = tf.sqrt(lab[..., 1] ** 2 + lab[..., 2] ** 2)
    marked = tf.cast((hue > low) & (hue < high) & (saturation > params.min_difference), tf.float32) * shown
    # What is thinner than two pixels, which are four of `leaf_colour`, is print.
    opened = 1 - tf.nn.max_pool2d((1 - marked)[None, ..., None], 2, 1, "SAME")
    marked = tf.nn.max_pool2d(tf.pad(opened, [[0, 0], [1, 0], [1, 0], [0, 0]]), 2, 1, "VALID")[0, ..., 0]
    areas = tf.reduce_sum(painted, [1, 2])
    number = tf.maximum(tf.reduce_sum(tf.cast(areas > 0, tf.int32)), 1)
    median = tf.gather(tf.math.top_k(areas, MAX_LEAVES)[0], (number - 1) // 2)
    least = tf.maximum(params.min_area_px * scale**2, params.min_area * median)
    components = find_components(marked)
    exist = components.count >= least
    ids = tf.where(exist, components.ids, -1.0)
    own = tf.cast(tf.equal(components.labels, ids[:, None, None]), tf.float32)
    own = tf.reshape(tf.tile(own[:, :, None, :, None], [1, 1, 2, 1, 2]), [MOST, side, side]) * marked
    pixel = square.side / side
    corner = tf.stack([square.left, square.top] * 2)
    things = Found(
        area=tf.where(exist, components.count, 0.0) * pixel**2,
        square=tf.tile(tf.stack([square.left, square.top, square.side])[None], [MOST, 1]),
        box=corner + components.boxes * pixel,
        leaf=own,
    )
    return Things(things, measure_colours(own, lab), measure_near(own, painted), lab)


def measure_near(things: tf.Tensor, painted: tf.Tensor) -> tf.Tensor:
    """Return the share [N] of each of `things` [N, s, s] that lies on leaves `painted` [L, s, s] or near."""
    near = grow_mask(tf.reduce_max(painted, 0), _NEAR_PX)
    return tf.reduce_sum(things * near, [1, 2]) / tf.maximum(tf.reduce_sum(things, [1, 2]), 1.0)


def measure_colours(masks: tf.Tensor, lab: tf.Tensor) -> tf.Tensor:
    """Return the mean [N, 3] of `lab` [s, s, 3] where each of `masks` [N, s, s] is 1."""
    flat = tf.reshape(masks, [masks.shape[0], -1])
    total = tf.matmul(flat, tf.reshape(lab, [-1, 3]))
    return total / tf.maximum(tf.reduce_sum(flat, 1, keepdims=True), 1.0)


def _estimate_sheet(image: tf.Tensor, bare: tf.Tensor, window: float) -> tf.Tensor:
    """Return the sheet's colour everywhere on `image` [s, s, 3]: in a window of a share of the side, the
    median of cells' mean colours where `bare` [s, s] is 1."""
    side = image.shape[0]
    cells = side // _CELL
    both = tf.concat([image * bare[..., None], bare[..., None]], -1)
    mean = tf.nn.avg_pool2d(both[None], _CELL, _CELL, "VALID")[0]
    is_bare = tf.cast(mean[..., 3] > 0.25, tf.float32)
    colours = mean[..., :3] / tf.maximum(mean[..., 3:], 1e-3)
    wide = int(window * cells) | 1
    # A convolution that copies each neighbour to a channel of its own.
    copies = np.eye(wide * wide, dtype=np.float32).reshape(wide, wide, 1, wide * wide)
    planes = tf.transpose(tf.concat([colours * is_bare[..., None], is_bare[..., None]], -1), [2, 0, 1])
    around = tf.nn.conv2d(planes[..., None], copies, 1, "SAME")
    counted = around[3]
    values = tf.sort(tf.where(counted > 0.5, around[:3], 1e4), axis=-1)
    number = tf.reduce_sum(counted, -1)
    middle = tf.one_hot(tf.cast(tf.maximum(number - 1, 0.0), tf.int32) // 2, wide * wide)
    median = tf.transpose(tf.reduce_sum(values * middle, -1), [1, 2, 0])
    # Where no paper is seen near, that of the whole photo counts.
    weight = is_bare[..., None] / tf.maximum(tf.reduce_sum(is_bare), 1.0)
    median = tf.where(number[..., None] > 0.5, median, tf.reduce_sum(colours * weight, [0, 1]))
    return tf.image.resize(median[None], [side, side])[0]


def to_lab(rgb: tf.Tensor) -> tf.Tensor:
    """Return the CIELAB colours [..., 3] of sRGB ones, 0..1, under D65, as OpenCV does."""
    linear = tf.where(rgb <= 0.04045, rgb / 12.92, tf.pow((tf.maximum(rgb, 0.0) + 0.055) / 1.055, 2.4))
    to_xyz = np.array(
        [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
    )
    to_xyz /= to_xyz.sum(axis=1, keepdims=True)
    ratios = tf.einsum("...c,kc->...k", linear, to_xyz.astype(np.float32))
    bent = tf.where(ratios > 0.008856, tf.pow(tf.maximum(ratios, 1e-6), 1 / 3), 7.787 * ratios + 16 / 116)
    x, y, z = tf.unstack(bent, axis=-1)
    return tf.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
