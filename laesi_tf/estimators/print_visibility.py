"""Where the print of a ruled sheet is seen, and where something hides it.

Once a sheet is fitted, the phase of its lines is known at every pixel. What the print looks like is averaged
over the bare paper, and each place is compared with that. Shadows dim print and paper alike, so that
brightness is compared on a logarithmic scale; what lies on the paper hides the print, even if it has the
paper's colour.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask
from laesi_tf.estimators.leaf_colour import largest_channel
from laesi_tf.estimators.mask_shapes import distance_inside, grow_mask
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop
from laesi_tf.estimators.sheet_map import SheetMap

SET_ON = (
    "rendered (split develop), semi-real (val), cases and phone scenes (1,024 px, seeds 78, 79), 2026-11-30"
)
"""What the parameters of print that is hidden were set on."""
_GRID_PX = 8
"""Sheet coordinates are computed at every eighth pixel and interpolated."""
_DARKEST_LEVEL, _BRIGHTEST_LEVEL = 8, 251
"""Pixels beyond these tell nothing."""
_LOG_LEVELS = np.log(np.maximum(np.arange(256), _DARKEST_LEVEL)).astype(np.float32)
_REPEAT = 10
"""After so many finest lines the print repeats itself. Heavier fourths are averaged with other lines; their
paper is seen nevertheless."""
_BINS = 160
"""Phases of that repeat that are distinguished."""


@dataclass(frozen=True, kw_only=True)
class PrintVisibilityParams:
    """Parameters of the comparison with the print."""

    least_px: float = parameter(2.5, unit="pixels per finest line", set_on="the sampling theorem")
    """Finer lines are not compared."""
    background: float = parameter(5.0, unit="finest lines", set_on="half a repeat of the print")
    """Side of the window whose mean is what the paper would be without print."""
    window: float = parameter(0.8, unit="finest lines", set_on=SET_ON)
    """Standard deviation of the Gaussian window in which print is compared."""
    max_contrast: float = parameter(0.5, unit="ln of brightness", set_on="dark lines on paper")
    """Pixels that differ more from the paper around them are not print: pens, desks, other things."""
    apart: float = parameter(2.0, unit="finest lines", set_on=SET_ON)
    """The print is sampled at this distance from leaves, and farther away."""
    least_pixels: float = parameter(20.0, unit="pixels per phase", set_on=SET_ON)
    """With fewer bare pixels nothing is compared."""
    max_error: float = parameter(0.25, unit="share of the print's contrast", set_on=SET_ON)
    """Standard error up to which a comparison tells something."""


@dataclass(frozen=True, eq=False)
class PrintVisibility:
    """How much of the print is seen at each pixel of a crop."""

    share: FloatMap
    """float32 [h, w], the print's contrast over that of bare paper: about 1 there, 0 where it is hidden."""
    is_known: Mask
    """bool [h, w], where the print has enough contrast to tell."""
    energy: FloatMap
    """float32 [h, w], how much print there is to see, over the mean of the bare paper."""
    px_per_line: float
    """Pixels of the crop from one finest line to the next."""


def measure_visibility(
    crop: Crop, sheet_map: SheetMap, pitch_mm: float, hidden: Mask, params: PrintVisibilityParams
) -> PrintVisibility | None:
    """Measure where the print of finest lines `pitch_mm` apart is seen on a crop.

    `hidden`, bool [h, w], are leaves: what they show is not compared. None where the lines are too fine, or
    hardly any paper is bare.
    """
    lines = _map_lines(crop, sheet_map, pitch_mm)
    px_per_line = _measure_period(lines)
    # False for a map that is not finite here, too.
    if not params.least_px <= px_per_line <= max(crop.size) / params.background:
        return None
    brightest = largest_channel(crop.image)
    is_exposed = (brightest <= _BRIGHTEST_LEVEL) & (brightest >= _DARKEST_LEVEL)
    logs = _LOG_LEVELS[crop.image]
    ink = logs @ _find_ink(logs, hidden, max(1, round(px_per_line / 2)))
    side = round(params.background * px_per_line) | 1
    contrast = _subtract_mean(ink, ~hidden, side)
    # A dark stroke spoils its surroundings: their mean is taken again without it.
    is_print = (np.abs(contrast) < params.max_contrast) & is_exposed
    usable = ~hidden & ~grow_mask(~is_print & ~hidden, 1)
    # What lies beside a leaf may hide the print, and is no sample of it.
    samples = usable & (distance_inside(~hidden) > params.apart * px_per_line)
    if np.count_nonzero(samples) < params.least_pixels * _BINS:
        return None
    contrast = _subtract_mean(ink, usable, side)
    weight = usable.astype(np.float32)
    expected = _average_print(contrast, lines, samples)
    sigma = params.window * px_per_line
    seen = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-6

    def average(values: FloatMap) -> FloatMap:
        return cv2.GaussianBlur(values * weight, (0, 0), sigma) / seen

    # The slope of what is seen on what is expected, as an offset is a shadow's.
    mean_expected = average(expected)
    likeness = average(contrast * expected) - average(contrast) * mean_expected
    energy = np.maximum(average(expected**2) - mean_expected**2, 1e-9)
    noise = 1.48 * np.median(np.abs(contrast - expected)[samples])
    # The sum of a Gaussian window's squares is one over its effective number of pixels.
    error = noise / np.sqrt(energy * 4 * np.pi * sigma**2 * seen)
    return PrintVisibility(
        share=likeness / energy,
        is_known=(error < params.max_error) & is_exposed & ~hidden,
        energy=energy / float(energy[samples].mean()),
        px_per_line=px_per_line,
    )


def _map_lines(crop: Crop, sheet_map: SheetMap, pitch_mm: float) -> NDArray[np.float32]:
    """Return sheet coordinates in finest lines, float32 [h, w, 2], of all pixels of a crop."""
    height, width = crop.size
    nodes = np.meshgrid(*(np.arange(0.0, side + _GRID_PX, _GRID_PX) for side in (width, height)))
    at_nodes = sheet_map.to_sheet(crop.to_photo(np.stack(nodes, -1))) / pitch_mm
    # Single precision keeps the fractions of small numbers.
    at_nodes -= _REPEAT * np.round(at_nodes[:1, :1] / _REPEAT)
    places = ((np.arange(side, dtype=np.float32) + 0.5) / _GRID_PX for side in (width, height))
    columns, rows = np.meshgrid(*places)
    lines: NDArray[np.float32] = cv2.remap(at_nodes.astype(np.float32), columns, rows, cv2.INTER_LINEAR)
    return lines


def _measure_period(lines: NDArray[np.float32]) -> float:
    """Return the pixels per line in the middle of `lines` [h, w, 2]."""
    row, column = (side // 2 for side in lines.shape[:2])
    here = lines[row, column]
    gradients = np.stack([lines[row, column - 1] - here, lines[row - 1, column] - here]).astype(np.float64)
    return float(1 / np.sqrt(max(abs(np.linalg.det(gradients)), 1e-12)))


def _subtract_mean(ink: FloatMap, counted: Mask, side: int) -> FloatMap:
    """Return `ink` [h, w] less its mean over the `counted` pixels, bool [h, w], of a window."""
    weight = counted.astype(np.float32)
    mean = cv2.blur(ink * weight, (side, side)) / np.maximum(cv2.blur(weight, (side, side)), 1e-3)
    return ink - mean


def _find_ink(logs: NDArray[np.float32], hidden: Mask, shift: int) -> NDArray[np.float32]:
    """Return the weights [3] of red, green and blue in which `logs` [h, w, 3] differ most `shift` pixels
    apart: on bare paper, between print and paper."""
    bare = ~(hidden[::2, shift:] | hidden[::2, :-shift])
    differences = (logs[::2, shift:] - logs[::2, :-shift])[bare]
    _, vectors = np.linalg.eigh(differences.T @ differences)
    weights: NDArray[np.float32] = vectors[:, -1] * np.sign(vectors[:, -1].sum())
    return weights / max(float(weights.sum()), 0.5)


def _average_print(contrast: FloatMap, lines: NDArray[np.float32], usable: Mask) -> FloatMap:
    """Return what the print looks like, float32 [h, w]: the sum of both families, averaged by phase."""
    expected, seen = np.zeros_like(contrast), contrast[usable]
    for family in (0, 1):
        phase = np.mod(lines[..., family], _REPEAT) * (_BINS / _REPEAT)
        bins = np.minimum(phase.astype(np.int32), _BINS - 1)
        chosen = bins[usable]
        count = np.maximum(np.bincount(chosen, minlength=_BINS), 1)
        profile = (np.bincount(chosen, seen, minlength=_BINS) / count).astype(np.float32)
        expected += (profile - profile.mean())[bins]
    return expected
