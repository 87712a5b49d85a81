"""Measure each leaf as the area of its mask times the scale that is printed on the paper."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from laesi_tf.common.geometry import compute_px_per_mm
from laesi_tf.estimators.area_estimator import AreaEstimator, AreaPrediction
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.camera_fit import Ruling
from laesi_tf.estimators.leaf_outline import LeafOutline, coarse_mask, paint_masks
from laesi_tf.estimators.mask_estimator import NO_LEAF, MaskEstimator
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling_reader.reader import read_ruling

METHOD = "ruling x silhouette"
FALLBACK = "regression, no ruling read"
FALLBACK_SCALE = "silhouette x scale of the area model, no ruling read"
LOW_CONFIDENCE = "the ruling was hard to read: look whether the lattice lies on it"
ROUGH_ESTIMATE = "no ruling read: a network's guess, which may be far off"
_CONFIDENT = 0.8
"""Confidence of the ruling below which the user is told to look."""
_LIFT_MM, _LIFT_SPREAD_MM = 0.2, 0.3
"""A leaf's upper side is above its paper: by its thickness, about 0.2 mm of a fresh leaf that lies flat, and
by what it rises between the points where it touches, of which no photo tells."""
_FOCAL = 0.75
"""Focal length of a phone's main camera in units of its picture's longer side: 26-27 mm on film 36 mm
wide."""
_SCALE_FLOOR = 0.0011
"""Relative standard deviation of the scale that stays with the clearest ruling."""
_GUESSED = 0.055
"""Relative standard deviation of the area model: two thirds of semi-real photographs, whose ruling is in
sight, are within it. Where it is not, no one knows, and the note says so."""
_SHOW_MORE = "show bare, sharp paper around the leaf"
_ADD_A_MODEL = f"{_SHOW_MORE}, or add an area model"


class RulingEstimator:
    """Segmentation and ruling together; an area network decides between families of lines and stands in."""

    def __init__(self, segmentation: MaskEstimator, regression: AreaEstimator | None = None) -> None:
        self._segmentation = segmentation
        self._regression = regression

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """As `Estimator.measure`; `known.grid_mm` is used, a known scale is not: the paper tells it."""
        views = PhotoPyramid(image)
        # The network learned its scale on millimetre paper; other paper would mislead it.
        adviser = self._regression if known.grid_mm == 1 else None
        # On a second core beside the search for leaves and their outlines.
        with ThreadPoolExecutor(1) as beside:
            guessing = beside.submit(lambda: None if adviser is None else adviser.guess(views))
            sights = self._segmentation.sights(views)
            covered = paint_masks(map(coarse_mask, sights), views.whole)
            reading = beside.submit(lambda: _read_ruling(views, covered, known.grid_mm, guessing.result()))
            outlines = self._segmentation.outlined(sights, views)
        guess, ruling = guessing.result(), reading.result()
        mask = paint_masks((outline.part for outline in outlines), views.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if ruling is None:
            advice = _SHOW_MORE if adviser or known.grid_mm != 1 else _ADD_A_MODEL
            return _fall_back_to_area_network(outlines, mask, guess, advice)
        to_mm = ruling.forward @ np.diag([*(1 / views.whole.step), 1.0])
        return Measurement(
            method=METHOD,
            leaves=tuple(_measure_leaf(outline, to_mm, ruling, views) for outline in outlines),
            mask=mask,
            to_mm=to_mm,
            tilt_deg=ruling.tilt_deg,
            note=LOW_CONFIDENCE if ruling.confidence < _CONFIDENT else None,
        )


def _read_ruling(
    views: PhotoPyramid, covered: np.ndarray, grid_mm: float, guess: AreaPrediction | None
) -> Ruling | None:
    """The ruling in the pixels of the shrunk photo, where it is not `covered`, bool [h, w]."""
    whole, about = views.whole, None if guess is None else guess.px_per_mm
    return read_ruling(
        whole.image,
        leaf=covered,
        grid_mm=grid_mm,
        about=None if about is None else about / float(whole.step[0]),
    )


def _measure_leaf(
    outline: LeafOutline, to_mm: np.ndarray, ruling: Ruling, views: PhotoPyramid
) -> LeafMeasurement:
    """The leaf through the ruling's homography, brought down from its height above the paper."""
    leaf = outline.leaf(to_mm)
    assert leaf.area_cm2 is not None and leaf.uncertainty_cm2 is not None
    distance = _FOCAL * float(views.size.max()) / compute_px_per_mm(to_mm, views.size / 2)
    shrink = max(0.0, 1 - _LIFT_MM / distance)
    area = leaf.area_cm2 * shrink**2
    of_scale = max(ruling.spread / math.sqrt(max(ruling.inliers, 1)), _SCALE_FLOOR)
    of_lift = _LIFT_SPREAD_MM / distance
    return dataclasses.replace(
        leaf,
        area_cm2=area,
        uncertainty_cm2=math.hypot(leaf.uncertainty_cm2, 2 * area * of_scale, 2 * area * of_lift),
    )


def _fall_back_to_area_network(
    outlines: list[LeafOutline], mask: np.ndarray, guess: AreaPrediction | None, advice: str
) -> Measurement:
    """The area network's idea of one leaf; of several its scale, as it knows pictures of one leaf only."""
    several = len(outlines) > 1
    if guess is None or not math.isfinite(guess.area_cm2) or (several and guess.px_per_mm is None):
        leaves = tuple(LeafMeasurement(**outline.drawn()) for outline in outlines)
        return Measurement(
            method=METHOD, leaves=leaves, mask=mask, refusal=f"no ruling can be read; {advice}"
        )
    if not several:
        uncertainty = _GUESSED * guess.area_cm2
        leaf = LeafMeasurement(area_cm2=guess.area_cm2, uncertainty_cm2=uncertainty, **outlines[0].drawn())
        return Measurement(method=FALLBACK, leaves=(leaf,), mask=mask, note=ROUGH_ESTIMATE)
    assert guess.px_per_mm is not None
    leaves = tuple(outline.leaf(np.diag([1.0, 1.0, guess.px_per_mm])) for outline in outlines)
    rough = tuple(
        dataclasses.replace(leaf, uncertainty_cm2=_GUESSED * (leaf.area_cm2 or 0.0)) for leaf in leaves
    )
    return Measurement(method=FALLBACK_SCALE, leaves=rough, mask=mask, note=ROUGH_ESTIMATE)
