"""Area as each leaf's silhouette times the scale that is printed on the paper.

A network finds the leaves, the ruling says how many mm2 each of their pixels covers, tilt included. Where no
ruling can be read, the area network stands in and the method says so.
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement
from laesi_tf.estimators.regression import Guess, Regression
from laesi_tf.estimators.ruling import Ruling, read_ruling
from laesi_tf.estimators.segmentation import NO_LEAF, Outline, Segmentation, coarse, filled
from laesi_tf.estimators.shape import px_per_mm
from laesi_tf.estimators.views import Views

METHOD = "ruling x silhouette"
FALLBACK = "regression, no ruling read"
FALLBACK_SCALE = "silhouette x scale of the area model, no ruling read"
FAINT = "the ruling was hard to read: look whether the lattice lies on it"
GUESSED = "no ruling read: a network's guess, which may be far off"
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


class Reading:
    """Segmentation and ruling together; an area network decides between families of lines and stands in."""

    def __init__(self, segmentation: Segmentation, regression: Regression | None = None) -> None:
        self._segmentation = segmentation
        self._regression = regression

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`; `known.grid_mm` is used, a known scale is not: the paper tells it."""
        views = Views(image)
        # The network learned its scale on millimetre paper; other paper would mislead it.
        adviser = self._regression if known.grid_mm == 1 else None
        # On a second core beside the search for leaves and their outlines.
        with ThreadPoolExecutor(1) as beside:
            guessing = beside.submit(lambda: None if adviser is None else adviser.guess(views))
            sights = self._segmentation.sights(views)
            covered = filled(map(coarse, sights), views.whole)
            reading = beside.submit(lambda: _ruling(views, covered, known.grid_mm, guessing.result()))
            outlines = self._segmentation.outlined(sights, views)
        guess, ruling = guessing.result(), reading.result()
        mask = filled((outline.part for outline in outlines), views.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if ruling is None:
            advice = _SHOW_MORE if adviser or known.grid_mm != 1 else _ADD_A_MODEL
            return _without_ruling(outlines, mask, guess, advice)
        to_mm = ruling.forward @ np.diag([*(1 / views.whole.step), 1.0])
        return Measurement(
            method=METHOD,
            leaves=tuple(_leaf(outline, to_mm, ruling, views) for outline in outlines),
            mask=mask,
            to_mm=to_mm,
            tilt_deg=ruling.tilt_deg,
            note=FAINT if ruling.confidence < _CONFIDENT else None,
        )


def _ruling(views: Views, covered: np.ndarray, grid_mm: float, guess: Guess | None) -> Ruling | None:
    """The ruling in the pixels of the shrunk photo, where it is not `covered`, bool [h, w]."""
    whole, about = views.whole, None if guess is None else guess.px_per_mm
    return read_ruling(
        whole.image,
        leaf=covered,
        grid_mm=grid_mm,
        about=None if about is None else about / float(whole.step[0]),
    )


def _leaf(outline: Outline, to_mm: np.ndarray, ruling: Ruling, views: Views) -> Leaf:
    """The leaf through the ruling's homography, brought down from its height above the paper."""
    leaf = outline.leaf(to_mm)
    assert leaf.area_cm2 is not None and leaf.uncertainty_cm2 is not None
    distance = _FOCAL * float(views.size.max()) / px_per_mm(to_mm, views.size / 2)
    shrink = max(0.0, 1 - _LIFT_MM / distance)
    area = leaf.area_cm2 * shrink**2
    of_scale = max(ruling.spread / math.sqrt(max(ruling.inliers, 1)), _SCALE_FLOOR)
    of_lift = _LIFT_SPREAD_MM / distance
    return dataclasses.replace(
        leaf,
        area_cm2=area,
        uncertainty_cm2=math.hypot(leaf.uncertainty_cm2, 2 * area * of_scale, 2 * area * of_lift),
    )


def _without_ruling(
    outlines: list[Outline], mask: np.ndarray, guess: Guess | None, advice: str
) -> Measurement:
    """The area network's idea of one leaf; of several its scale, as it knows pictures of one leaf only."""
    several = len(outlines) > 1
    if guess is None or not math.isfinite(guess.area_cm2) or (several and guess.px_per_mm is None):
        leaves = tuple(Leaf(**outline.drawn()) for outline in outlines)
        return Measurement(
            method=METHOD, leaves=leaves, mask=mask, refusal=f"no ruling can be read; {advice}"
        )
    if not several:
        uncertainty = _GUESSED * guess.area_cm2
        leaf = Leaf(area_cm2=guess.area_cm2, uncertainty_cm2=uncertainty, **outlines[0].drawn())
        return Measurement(method=FALLBACK, leaves=(leaf,), mask=mask, note=GUESSED)
    assert guess.px_per_mm is not None
    leaves = tuple(outline.leaf(np.diag([1.0, 1.0, guess.px_per_mm])) for outline in outlines)
    rough = tuple(
        dataclasses.replace(leaf, uncertainty_cm2=_GUESSED * (leaf.area_cm2 or 0.0)) for leaf in leaves
    )
    return Measurement(method=FALLBACK_SCALE, leaves=rough, mask=mask, note=GUESSED)
