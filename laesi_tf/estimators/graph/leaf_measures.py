"""Measure leaves inside a graph: soft area through the camera, length, width, and which leaves count."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.common.sheet_model import to_lines
from laesi_tf.estimators.graph.close_looks import MAX_LEAVES, Found
from laesi_tf.estimators.graph.components import find_ends
from laesi_tf.estimators.leaf_candidates import LeafDetectorParams
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.ruling.camera_ops import squares_per_area, unpack_sheet

_SAMPLES = 56
"""Points per side of a crop at which two leaves are compared."""
_BLOCK = 8
"""Side in network pixels of the blocks in which the scale counts as one."""
_DIRECTIONS = 32


@dataclass(frozen=True, kw_only=True)
class LeafMeasureParams:
    """Parameters of areas."""

    border_px: float = parameter(1.0, unit="network pixels")
    """A leaf that comes so close to the photo's border is assumed to continue beyond it."""


class Sheet(NamedTuple):
    """What maps the frame to the paper."""

    parameters: tf.Tensor
    """[COUNT], see `SheetModel`."""
    pitch_mm: tf.Tensor
    """Distance of the finest lines, scalar."""
    size: tf.Tensor
    """[2], height and width of the photo in the frame."""

    def normalise(self, points: tf.Tensor) -> tf.Tensor:
        """Return `points` [..., 2] of the frame in units of half the longer side from the middle."""
        return (points - tf.reverse(self.size, [0]) / 2) / (tf.reduce_max(self.size) / 2)

    def to_lines(self, points: tf.Tensor) -> tf.Tensor:
        """Return sheet coordinates [..., 2] of `points` [..., 2] of the frame; lines lie at whole numbers."""
        place = self.normalise(points)
        return tf.stack(to_lines(unpack_sheet(self.parameters), place[..., 0], place[..., 1]), -1)

    def to_mm(self, points: tf.Tensor) -> tf.Tensor:
        """Return sheet millimetres [..., 2] of `points` [..., 2] of the frame."""
        return self.to_lines(points) * self.pitch_mm

    def mm2_per_px(self, points: tf.Tensor) -> tf.Tensor:
        """Return the square millimetres [...] under a frame pixel at `points` [..., 2]."""
        density = squares_per_area(self.parameters, self.normalise(points))
        return density * self.pitch_mm**2 / (tf.reduce_max(self.size) / 2) ** 2


class LeafMeasures(NamedTuple):
    """[MAX_LEAVES] each; for the places without a leaf without meaning."""

    area_mm2: tf.Tensor
    px_mm2: tf.Tensor
    """Mean area of a network pixel."""
    perimeter_px: tf.Tensor
    """Length of the outline in network pixels."""
    length_mm: tf.Tensor
    width_mm: tf.Tensor
    middle: tf.Tensor
    """[L, 2], the area's centroid in frame pixels."""
    is_cut_off: tf.Tensor


def choose_distinct(found: Found, params: LeafDetectorParams) -> tuple[Found, tf.Tensor]:
    """Return `found` by falling area, and which of them count: small fragments and parts of larger ones do
    not; see `leaf_candidates.remove_duplicates`."""
    area, order = tf.math.top_k(found.area, MAX_LEAVES)
    found = Found(area, *(tf.gather(part, order) for part in found[1:]))
    is_several = tf.gather(area, 1) > 0
    nothing = tf.zeros([MAX_LEAVES, MAX_LEAVES])
    cover = tf.cond(is_several, lambda: _measure_cover(found), lambda: nothing)
    counts = [tf.gather(area, 0) > 0]
    for index in range(1, MAX_LEAVES):
        covered = [counts[other] & (cover[index, other] > params.duplicate_cover) for other in range(index)]
        is_large = (area[index] > 0) & (area[index] >= params.min_area_of_largest * area[0])
        counts.append(is_large & ~tf.reduce_any(tf.stack(covered)))
    return found, tf.stack(counts)


def _measure_cover(found: Found) -> tf.Tensor:
    """Return the share [L, L] of each leaf that lies on each other one, at sample points."""
    side = found.leaf.shape[1]
    step = side // _SAMPLES
    own = tf.cast(found.leaf >= 0.5, tf.float32)
    inner = own[:, step // 2 :: step, step // 2 :: step]
    offsets = (np.arange(_SAMPLES) * step + step // 2 + 0.5).astype(np.float32) / side
    left, top, wide = (part[:, None] for part in tf.unstack(found.square, axis=1))
    # Of each leaf, in each other one, at each sample.
    columns, rows = (
        (((low + offsets * wide)[:, None] - low[None]) / tf.maximum(wide, 1e-3)[None] * side)
        for low in (left, top)
    )
    inside = [tf.cast((place >= 0) & (place < side), tf.float32) for place in (columns, rows)]
    column, row = (tf.cast(tf.clip_by_value(place, 0.0, side - 1.0), tf.int32) for place in (columns, rows))
    first = (tf.range(MAX_LEAVES) * side * side)[None, :, None, None]
    places = first + row[..., :, None] * side + column[..., None, :]
    there = tf.gather(tf.reshape(own, [-1]), tf.reshape(places, [-1]))
    there = tf.reshape(there, [MAX_LEAVES, MAX_LEAVES, _SAMPLES, _SAMPLES])
    there *= inside[1][..., :, None] * inside[0][..., None, :]
    shared = tf.reduce_sum(there * inner[:, None], [2, 3])
    return shared / tf.maximum(tf.reduce_sum(inner, [1, 2])[:, None], 1.0)


def measure_leaves(found: Found, sheet: Sheet, params: LeafMeasureParams) -> LeafMeasures:
    """Measure all leaves of `found`, whose `leaf` is the share of each pixel that is leaf, on `sheet`."""
    side = found.leaf.shape[1]
    pixel = tf.maximum(found.square[:, 2], 1e-3)[:, None] / side
    blocks, points = _average_blocks(found, found.leaf)
    area_px = sheet.mm2_per_px(points) * pixel[..., None] ** 2
    share = blocks * _BLOCK**2 * area_px
    area = tf.reduce_sum(share, [1, 2])
    weights = (share / tf.maximum(area, 1e-9)[:, None, None])[..., None]
    middle = tf.reduce_sum(points * weights, [1, 2])
    places = sheet.to_mm(points)
    apart = places - tf.reduce_sum(places * weights, [1, 2], keepdims=True)
    xx, xy, yy = (
        tf.reduce_sum(apart[..., i] * apart[..., j] * weights[..., 0], [1, 2])
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    turn = tf.atan2(2 * xy, xx - yy) / 2
    axis = tf.stack([tf.cos(turn), tf.sin(turn)], -1)
    along = _measure_extent(found, sheet, tf.stack([axis, tf.reverse(axis, [1]) * [-1.0, 1.0]], 1))
    corner = found.leaf[:, :-1, :-1]
    slope = (found.leaf[:, 1:, :-1] - corner) ** 2 + (found.leaf[:, :-1, 1:] - corner) ** 2
    margin = params.border_px * pixel
    is_cut_off = (found.box[:, :2] <= margin) | (found.box[:, 2:] >= tf.reverse(sheet.size, [0]) - margin)
    return LeafMeasures(
        area_mm2=area,
        px_mm2=area / tf.maximum(tf.reduce_sum(found.leaf, [1, 2]), 1e-9),
        perimeter_px=tf.reduce_sum(tf.sqrt(slope + 1e-12), [1, 2]),
        length_mm=along[:, 0],
        width_mm=along[:, 1],
        middle=middle,
        is_cut_off=tf.reduce_any(is_cut_off, 1),
    )


def _average_blocks(found: Found, values: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the means [L, b, b] of `values` [L, s, s] over blocks, and the middles of these [L, b, b, 2] in
    the frame."""
    side = found.leaf.shape[1]
    blocks = tf.nn.avg_pool2d(values[..., None], _BLOCK, _BLOCK, "VALID")[..., 0]
    middles = (np.arange(side // _BLOCK, dtype=np.float32) + 0.5) * _BLOCK
    return blocks, _to_frame(found.square, side, *np.meshgrid(middles, middles))


def _to_frame(square: tf.Tensor, side: int, x: tf.Tensor, y: tf.Tensor) -> tf.Tensor:
    """Return the frame points [L, ..., 2] of `x` and `y` [...] or [L, ...], pixels of the crops `square`
    [L, 3]."""
    shape = [MAX_LEAVES] + [1] * (len(x.shape) - (1 if x.shape[0] == MAX_LEAVES else 0))
    left, top, wide = (tf.reshape(part, shape) for part in tf.unstack(square, axis=1))
    return tf.stack([left + x * wide / side, top + y * wide / side], -1)


def find_edges(found: Found) -> tuple[tf.Tensor, tf.Tensor]:
    """Return frame points [L, 4 s, 2] on the outer edges of the leaves, and which of them exist, [L, 4 s]:
    the ends of each row and of each column."""
    side = found.leaf.shape[1]
    own = tf.cast(found.leaf >= 0.5, tf.float32)
    places = np.arange(side, dtype=np.float32)
    xs, ys, exist = [], [], []
    for axis, lines in ((2, own), (1, tf.transpose(own, [0, 2, 1]))):
        low, high = find_ends(lines)
        across = tf.ones_like(low) * (places + 0.5)
        for end in (low, high):
            x, y = (end, across) if axis == 2 else (across, end)
            xs.append(x)
            ys.append(y)
            exist.append(high > 0)
    return _to_frame(found.square, side, tf.concat(xs, 1), tf.concat(ys, 1)), tf.concat(exist, 1)


def _measure_extent(found: Found, sheet: Sheet, axes: tf.Tensor) -> tf.Tensor:
    """Return the extents [L, A] of the leaves along `axes` [L, A, 2] on the sheet, mm."""
    points, exist = find_edges(found)
    along = tf.matmul(sheet.to_mm(points), axes, transpose_b=True)
    there = exist[..., None]
    high = tf.reduce_max(tf.where(there, along, -1e9), 1)
    return tf.maximum(high - tf.reduce_min(tf.where(there, along, 1e9), 1), 0.0)


def measure_share_on(found: Found, agreement: tf.Tensor, *, least: float, cell_px: float) -> tf.Tensor:
    """Return the share [L] of each leaf that lies on the convex hull of the cells of `agreement` [C, C] above
    the `least`.

    The hull is that of 32 directions, at most 0.5 % of its radius too wide.
    """
    turns = 2 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across, down = np.cos(turns).astype(np.float32) * cell_px, np.sin(turns).astype(np.float32) * cell_px
    first, last = find_ends(tf.cast(agreement > least, tf.float32))
    places = np.arange(agreement.shape[0], dtype=np.float32)
    reach = tf.maximum(first[:, None] * across, last[:, None] * across)
    reach += np.maximum(places[:, None] * down, (places[:, None] + 1) * down)
    limits = tf.reduce_max(tf.where(last[:, None] > 0, reach, -1e9), 0)
    normals = np.stack([across, down]) / cell_px
    blocks, points = _average_blocks(found, tf.cast(found.leaf >= 0.5, tf.float32))
    beyond = tf.reduce_max(tf.matmul(tf.reshape(points, [-1, 2]), normals) - limits, -1)
    inside = tf.reshape(tf.cast(beyond <= 0, tf.float32), blocks.shape)
    return tf.reduce_sum(inside * blocks, [1, 2]) / tf.maximum(tf.reduce_sum(blocks, [1, 2]), 1e-9)
