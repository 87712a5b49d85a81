"""Crops of a photo inside a graph: a square of any size, resampled to a network's input.

Two products with interpolation matrices, as a graph that LiteRT runs has no resizing of a crop. The filter is
the antialiased triangle of `data.letterbox`, on the level of a pyramid that is not much finer than the
output.
"""

from typing import NamedTuple

import tensorflow as tf

from laesi_tf.models.ruling_cells import FRAME_PX

_LEVELS = 3


class Square(NamedTuple):
    """A square of the frame, of which a rectangle shows the photo; frame pixels, scalars."""

    left: tf.Tensor
    top: tf.Tensor
    side: tf.Tensor
    shown: tf.Tensor
    """[4], left, top, right, bottom of what is cropped; the rest of the square is padding."""


def make_levels(photo: tf.Tensor, side: int) -> list[tf.Tensor]:
    """Return uint8 [h, w, 3] levels of a frame, uint8 [FRAME_PX, FRAME_PX, 3], for crops of `side` pixels.

    Each is half as wide as the one before, and at least as wide as a window of `cut_square`. They are uint8,
    as a loop copies what it uses.
    """
    levels, image = [photo], tf.cast(photo, tf.float32)
    for _ in range(_LEVELS - 1):
        image = tf.nn.avg_pool2d(image[None], 2, 2, "VALID")[0]
        missing = max(0, _window(side) - image.shape[0])
        levels.append(tf.cast(tf.pad(tf.round(image), [[0, missing], [0, missing], [0, 0]]), tf.uint8))
    return levels


def fit_square(box: tf.Tensor, size: tf.Tensor) -> Square:
    """Return the square around what `box` [4] (left, top, right, bottom) shows of a photo of `size` [2],
    (height, width), as if that were cropped and put into a square by `letterbox_image`."""
    width_height = tf.reverse(size, [0])
    low = tf.clip_by_value(box[:2], 0.0, width_height - 1)
    high = tf.minimum(tf.maximum(box[2:], low + 1), width_height)
    side = tf.reduce_max(high - low)
    corner = (low + high - side) / 2
    return Square(corner[0], corner[1], side, tf.concat([low, high], 0))


def cut_square(levels: list[tf.Tensor], square: Square, side: int) -> tf.Tensor:
    """Return the pixels, float32 [side, side, 3] of 0..255, of `square`.

    Padding has the median colour of the border of what is shown.
    """
    window = _window(side)
    level, scale = _choose_level(square, side)
    starts, matrices, inside = [], [], []
    for low, axis in ((square.top, 1), (square.left, 0)):
        start = tf.cast(tf.floor(low / scale), tf.int32) - 2
        width = tf.cast(FRAME_PX / scale, tf.int32)
        start = tf.clip_by_value(start, 0, tf.maximum(width - window, 0))
        centres = low + (tf.range(side, dtype=tf.float32) + 0.5) * (square.side / side)
        pixels = (tf.cast(start + tf.range(window), tf.float32) + 0.5) * scale
        first, last = square.shown[axis], square.shown[axis + 2]
        reach = tf.maximum(scale, square.side / side)
        weights = tf.maximum(0.0, 1 - tf.abs(pixels - centres[:, None]) / reach)
        weights *= tf.cast((pixels > first) & (pixels < last), tf.float32)
        starts.append(start)
        matrices.append(weights / tf.maximum(tf.reduce_sum(weights, 1, keepdims=True), 1e-6))
        inside.append((centres > first) & (centres < last))
    parts = []
    for image in levels:
        # Of a coarser level than the chosen one too, whose window is then not used.
        corner = [tf.minimum(start, image.shape[0] - window) for start in starts]
        part = tf.slice(image, tf.stack([*corner, 0]), [window, window, 3])
        parts.append(tf.cast(part, tf.float32))
    pixels = tf.where(level < 0.5, parts[0], tf.where(level < 1.5, parts[1], parts[2]))
    rows = tf.reshape(tf.matmul(matrices[0], tf.reshape(pixels, [window, window * 3])), [side, window, 3])
    # [columns, side * 3] by way of the columns, which come first for the second product.
    turned = tf.reshape(tf.transpose(rows, [1, 0, 2]), [window, side * 3])
    small = tf.transpose(tf.reshape(tf.matmul(matrices[1], turned), [side, side, 3]), [1, 0, 2])
    shown = inside[0][:, None] & inside[1]
    return tf.round(tf.where(shown[..., None], small, _find_border_colour(small, *inside)))


def interpolate_square(levels: list[tf.Tensor], square: Square, side: int) -> tf.Tensor:
    """Return the pixels, float32 [side, side, 3] of 0..255, of `square`, interpolated between those of the
    level that is not much finer.

    In a large crop, the products of `cut_square` would take long. What lies beyond the photo is not defined.
    """
    chosen, _ = _choose_level(square, side)
    crops = []
    for level, image in enumerate(levels):
        last = image.shape[0] - 1
        parts, shares = [], []
        for low in (square.top, square.left):
            places = low + (tf.range(side, dtype=tf.float32) + 0.5) * (square.side / side)
            place = tf.clip_by_value(places / 2.0**level - 0.5, 0.0, last - 1e-3)
            first = tf.cast(tf.floor(place), tf.int32)
            parts.append((first, first + 1))
            shares.append(place - tf.floor(place))
        rows = []
        for row in (tf.gather(image, row, axis=0) for row in parts[0]):
            before, after = (tf.cast(tf.gather(row, column, axis=1), tf.float32) for column in parts[1])
            rows.append(_mix(before, after, shares[1][:, None]))
        crops.append(_mix(rows[0], rows[1], shares[0][:, None, None]))
    result = crops[-1]
    for level in reversed(range(len(levels) - 1)):
        result = tf.where(chosen < level + 0.5, crops[level], result)
    return result


def _mix(first: tf.Tensor, second: tf.Tensor, share: tf.Tensor) -> tf.Tensor:
    return first + (second - first) * share


def show_square(square: Square, side: int) -> tf.Tensor:
    """Return 1, [side, side], where `square` shows the photo, else 0."""
    centres = (tf.range(side, dtype=tf.float32) + 0.5) * (square.side / side)
    columns, rows = (
        tf.cast((place > square.shown[axis]) & (place < square.shown[axis + 2]), tf.float32)
        for axis, place in enumerate((square.left + centres, square.top + centres))
    )
    return rows[:, None] * columns


def _choose_level(square: Square, side: int) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the level with at most two pixels for one of the output, as far as there is one, and the frame
    pixels per pixel of it, float scalars."""
    level = tf.math.ceil(tf.math.log(square.side / (2 * side)) / tf.math.log(2.0))
    level = tf.clip_by_value(level, 0.0, _LEVELS - 1.0)
    return level, tf.pow(2.0, level)


def _window(side: int) -> int:
    """Return how many pixels of a level a crop touches at most."""
    return 2 * side + 8


def _find_border_colour(image: tf.Tensor, rows: tf.Tensor, columns: tf.Tensor) -> tf.Tensor:
    """Return the median [3] of the border of the part of `image` [s, s, 3] in `rows` and `columns`, bool
    [s]."""
    side = image.shape[0]
    places = tf.range(side)
    lines, used = [], []
    for along, across, picture in ((rows, columns, image), (columns, rows, tf.transpose(image, [1, 0, 2]))):
        flags = tf.cast(along, tf.int32)
        # Of a strip thinner than a pixel, no row is inside.
        first = tf.minimum(side - tf.reduce_max(flags * (side - places)), side - 1)
        last = tf.reduce_max(flags * places)
        lines += [tf.gather(picture, first), tf.gather(picture, last)]
        used += [across, across]
    values, mask = tf.concat(lines, 0), tf.concat(used, 0)
    count = tf.reduce_sum(tf.cast(mask, tf.int32))
    order = tf.sort(tf.where(mask, tf.transpose(values), 1e9), axis=-1)
    return tf.gather(order, tf.maximum(count - 1, 0) // 2, axis=1)
