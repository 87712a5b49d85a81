"""The sheet and the desk: colour, noise and wear, crease, ruling and edges (paper, section 3.1)."""

import math
from typing import NamedTuple

import tensorflow as tf

from laesi_tf.synthesis import noise
from laesi_tf.synthesis.camera.view import CameraView
from laesi_tf.synthesis.colour import hsv_to_rgb
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.paper import ruling
from laesi_tf.synthesis.paper.desk import DeskParams, desk_grain, paint_desk, shade_beside_sheet
from laesi_tf.synthesis.paper.desk_kinds import desk_colour, desk_pattern
from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.ranges import Scalar

GRADIENT_NODES = 16
SIMPLE_NODES = 30


class SheetNoiseGrids(NamedTuple):
    """Uniform numbers from which a sheet's noise is interpolated, each [2, n, n].

    `gradients`, `values` (first those of the blend, then those of the ink), and Voronoi `jitter`.
    """

    gradients: tf.Tensor
    values: tf.Tensor
    jitter: tf.Tensor


def paint_sheet_and_desk(
    paper: PaperParams[Scalar],
    sheet_grids: SheetNoiseGrids,
    desk: DeskParams[Scalar],
    desk_grid: tf.Tensor,
    outline: tf.Tensor,
    view: CameraView,
    ruling_cells: tf.Tensor | None,
    size: ImageSize,
    components: tuple[str, ...],
) -> tf.Tensor:
    """Paint the sheet, and the desk where the sheet ends: [3, H, W].

    `outline` [n, 2] is the leaf's in sheet mm; `ruling_cells` int32 [2, H, W] come from
    `compute_ruling_cells`, None without a ruling.
    """
    colour, shade, ink_strength, coverage = sheet_colour(paper), tf.ones(size), None, None
    if "paper_noise" in components:
        blend, ink_strength = paper_noise(paper, sheet_grids, size)
        shade += blend
    if "crease" in components:
        shade = tf.cond(
            paper.creased,
            lambda: shade + crease_shading(paper, *view.pixel_centres_to_sheet(size), view.fov_mm),
            lambda: shade,
        )
    if ruling_cells is not None and "paper_kinds" in components:
        samples = ruling.samples_of_any_kind(size)
        transmission = ruling.pack_kind_transmission(paper, samples, 1 / view.px_per_mm)
        coverage = ruling.look_up_line_coverage(transmission, ruling_cells, dotted=paper.dotted)
    elif ruling_cells is not None:
        transmission = ruling.pack_line_transmission(paper, ruling.samples_per_mm(size), 1 / view.px_per_mm)
        coverage = ruling.look_up_line_coverage(transmission, ruling_cells)

    def ink() -> tf.Tensor | float:
        if coverage is None:
            return 0.0
        absorbance = ruling.compute_ink_absorbance(paper, *coverage)
        return absorbance if ink_strength is None else absorbance * ink_strength

    def sheet_everywhere() -> tf.Tensor:
        return colour * shade * (1 - ink())

    def sheet_on_desk() -> tf.Tensor:
        place = view.pixel_centres_to_sheet(size)
        distance_mm, border_mm = find_sheet(paper, outline, *place, components)
        is_printed = tf.clip_by_value((distance_mm - border_mm) * view.px_per_mm + 0.5, 0, 1)
        is_sheet = tf.clip_by_value(distance_mm * view.px_per_mm + 0.5, 0, 1)
        if "desk_kinds" in components:
            pattern = desk_pattern(desk, desk_grid, *place, view.px_per_mm, size)
            table = desk_colour(desk) * (pattern * shade_beside_sheet(desk, distance_mm))
        else:
            table = paint_desk(desk, desk_grain(desk, desk_grid, size), distance_mm)
        return table + is_sheet * (colour * shade * (1 - is_printed * ink()) - table)

    return (
        tf.cond(paper.edged, sheet_on_desk, sheet_everywhere) if "desk" in components else sheet_everywhere()
    )


def find_sheet(
    paper: PaperParams[Scalar],
    outline: tf.Tensor,
    x_mm: tf.Tensor,
    y_mm: tf.Tensor,
    components: tuple[str, ...],
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the distance [H, W] in mm to the edge of an `edged` sheet, and its unprinted border in mm, [].

    Arguments are those of `distance_to_sheet_edge`; distances are negative off the sheet.
    """
    if "cut_sheet" not in components:
        return distance_to_sheet_edge(paper, outline, x_mm, y_mm), paper.border_mm
    border_mm = tf.where(paper.cut, 0.0, paper.border_mm)
    return distance_to_any_sheet_edge(paper, outline, x_mm, y_mm), border_mm


def paper_noise(
    paper: PaperParams[Scalar], grids: SheetNoiseGrids, size: ImageSize
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return the blended noise L of the paper's section 3.1 and the ink's relative strength, [H, W] each."""
    fields = (
        noise.gradient_noise(grids.gradients * 2 - 1, size, cells=paper.gradient_cells),
        noise.voronoi_noise(grids.jitter, size, cells=paper.voronoi_cells),
        noise.simple_noise(grids.values[0], size, cells=paper.simple_cells),
    )
    weights = (paper.gradient_weight, paper.voronoi_weight, paper.simple_weight)
    wear = noise.interpolate_grid(grids.values[1], size, cells=paper.simple_cells)
    return noise.blend_noises(weights, fields).values, 1 - paper.print_wear * wear.values


def crease_shading(
    paper: PaperParams[Scalar], x_mm: tf.Tensor, y_mm: tf.Tensor, fov_mm: tf.Tensor
) -> tf.Tensor:
    """Return the relief shading [H, W] of a fold across the sheet: one flank brighter, the other darker."""
    cosine, sine = tf.cos(paper.crease_angle), tf.sin(paper.crease_angle)
    distance = (x_mm * cosine + (y_mm * sine - paper.crease_offset * fov_mm)) / 1.2
    return paper.crease_depth * 2 * distance * tf.exp(-distance * distance)


def sheet_colour(paper: PaperParams[Scalar]) -> tf.Tensor:
    """Return the base colour of the sheet, [3, 1, 1] in [0, 1]."""
    saturation = paper.saturation * tf.cast(paper.tinted, tf.float32) + 0.02
    return hsv_to_rgb(paper.hue, saturation)[:, None, None] * paper.brightness


def distance_to_sheet_edge(
    paper: PaperParams[Scalar], outline: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor
) -> tf.Tensor:
    """Return the distance [H, W] in mm to the nearest side of the sheet; negative off the sheet.

    The sheet surrounds the leaf's `outline` [n, 2]; all positions are in sheet mm.
    """
    low = tf.reduce_min(outline, axis=0) - tf.stack([paper.left, paper.top])
    high = tf.reduce_max(outline, axis=0) + tf.stack([paper.right, paper.bottom])
    middle, half = (low + high) / 2, (high - low) / 2
    return tf.minimum(half[0] - tf.abs(x_mm - middle[0]), half[1] - tf.abs(y_mm - middle[1]))


def distance_to_any_sheet_edge(
    paper: PaperParams[Scalar], outline: tf.Tensor, x_mm: tf.Tensor, y_mm: tf.Tensor
) -> tf.Tensor:
    """Return the same as `distance_to_sheet_edge` for a sheet that may be cut to any quadrilateral."""
    angles = tf.stack([paper.cut_left, paper.cut_right, paper.cut_top, paper.cut_bottom]) + paper.cut_turn
    angles = angles * tf.cast(paper.cut, tf.float32) + tf.constant([1.0, 0.0, 1.5, 0.5]) * math.pi
    outward = tf.stack([tf.cos(angles), tf.sin(angles)], axis=-1)
    margins = tf.stack([paper.left, paper.right, paper.top, paper.bottom])
    margins *= tf.where(paper.scrap, paper.scrap_share, 1.0)
    reach = tf.reduce_max(tf.linalg.matmul(outward, outline, transpose_b=True), axis=1) + margins
    (left, right, top, bottom) = (
        reach[side] - outward[side, 0] * x_mm - outward[side, 1] * y_mm for side in range(4)
    )
    return tf.minimum(tf.minimum(left, right), tf.minimum(top, bottom))
