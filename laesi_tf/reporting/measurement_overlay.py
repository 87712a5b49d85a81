"""Draw what was measured on a photo: grid, numbered outlines, and the results as text below."""

import math

import numpy as np

from laesi_tf.common.arrays import Mask, Points, RgbImage
from laesi_tf.common.geometry import ImageSize, trace_polygons
from laesi_tf.common.result_files import OVERLAY_SIDE_PX
from laesi_tf.common.text import sanitise_text
from laesi_tf.estimators.base import Measurement
from laesi_tf.reporting.captions import add_caption, draw_labels
from laesi_tf.reporting.overlay import (
    PREDICTED_COLOUR,
    TRUE_COLOUR,
    draw_grid,
    draw_outlines,
    resize,
)

_MAX_NOTES = 3
_MAX_AREAS = 20
"""Leaves whose areas are written on them; of more, only the numbers fit."""
_LABEL_SHARE = 0.4
"""Height of the letters then, in widths of the median leaf."""


def draw_measurement(
    image: RgbImage, measurement: Measurement, name: str, *, side: int = OVERLAY_SIDE_PX
) -> RgbImage:
    """Return `image`, uint8 [H, W, 3], with grid, outlines and results: uint8 [h, w, 3].

    Its longer side has at most `side` pixels. `name` stands below the results.
    """
    # A small photo is enlarged until the text below can be read.
    side = min(side, max(OVERLAY_SIDE_PX // 2, *image.shape[:2]))
    overlay = resize(image, side)
    scale = ImageSize.of(overlay).xy / ImageSize.of(image).xy
    if measurement.camera is not None:
        overlay = draw_grid(overlay, measurement.camera, scale=scale)
    rings = [(ring * scale, PREDICTED_COLOUR) for leaf in measurement.leaves for ring in leaf.rings]
    overlay = draw_outlines(overlay, rings)
    if len(measurement.leaves) > 1:
        labels, height = _number_leaves(measurement, scale)
        overlay = draw_labels(overlay, labels, max_height=height)
    lines = [*describe_measurement(measurement), f"{sanitise_text(name)}  ({measurement.method})"]
    return add_caption(overlay, lines)


def draw_comparison(
    image: RgbImage, measurement: Measurement, true_mask: Mask | None, *, side: int
) -> RgbImage:
    """Return `image`, uint8 [H, W, 3], with a longer side of `side` pixels and true and predicted outlines.

    `true_mask` is bool [H, W], or None where it is not known.
    """
    drawn = resize(image, side)
    scale = ImageSize.of(drawn).xy / ImageSize.of(image).xy
    true_rings = (
        [] if true_mask is None else [ring for leaf in trace_polygons(true_mask) for ring in leaf.rings]
    )
    outlines = [(ring * scale, TRUE_COLOUR) for ring in true_rings]
    outlines += [(ring * scale, PREDICTED_COLOUR) for leaf in measurement.leaves for ring in leaf.rings]
    return draw_outlines(drawn, outlines)


def describe_measurement(measurement: Measurement) -> list[str]:
    """Return the results and the reasons to doubt them as lines of text."""
    if measurement.refusal is not None:
        return [f"refused: {measurement.refusal}"]
    leaves = measurement.leaves
    results = [_format_area(measurement)]
    if scales := [leaf.px_per_mm for leaf in leaves if leaf.px_per_mm is not None]:
        results.append(f"{np.mean(scales):.2f} px/mm")
    if measurement.tilt_deg is not None:
        results.append(f"tilt {measurement.tilt_deg:.0f}°")
    if len(leaves) == 1 and leaves[0].length_mm is not None and leaves[0].width_mm is not None:
        results.append(f"{leaves[0].length_mm:.1f} × {leaves[0].width_mm:.1f} mm")
    notes = [measurement.note] if measurement.note else []
    notes += [
        f"leaf {number}: {leaf.note}" if len(leaves) > 1 else leaf.note
        for number, leaf in enumerate(leaves, 1)
        if leaf.note
    ]
    return [", ".join(results), *notes[:_MAX_NOTES]]


def _format_area(measurement: Measurement) -> str:
    """Return the area of all leaves and its uncertainty as text."""
    area, uncertainty = measurement.area_cm2 or 0.0, measurement.uncertainty_cm2
    text = f"{area:.2f} cm²" if uncertainty is None else f"{area:.2f} ± {uncertainty:.2f} cm²"
    return text if len(measurement.leaves) == 1 else f"{len(measurement.leaves)} leaves, {text}"


def _number_leaves(measurement: Measurement, scale: Points) -> tuple[list[tuple[Points, str]], float]:
    """Return the position in the overlay and the text of each leaf's label, and the height of the letters.

    A label is the leaf's number and, where there are few leaves, its area.
    """
    labels, sides = [], []
    with_areas = len(measurement.leaves) <= _MAX_AREAS
    for number, leaf in enumerate(measurement.leaves, 1):
        if leaf.outline is not None:
            low, high = leaf.outline.min(axis=0) * scale, leaf.outline.max(axis=0) * scale
            has_area = with_areas and leaf.area_cm2 is not None
            labels.append(((low + high) / 2, f"{number}: {leaf.area_cm2:.2f}" if has_area else str(number)))
            sides.append(float((high - low).min()))
    return labels, math.inf if with_areas or not sides else _LABEL_SHARE * float(np.median(sides))
