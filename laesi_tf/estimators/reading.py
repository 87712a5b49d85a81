"""Area as the leaf's silhouette times the scale that is printed on the paper.

A network outlines the leaf, the ruling says how many mm2 each of its pixels covers, tilt included. Where no
ruling can be read, the regression's area stands in and the method says so.
"""

import math

import cv2
import numpy as np

from laesi_tf.estimators.base import NOTHING, Known, Leaf, Measurement, trace
from laesi_tf.estimators.regression import Regression
from laesi_tf.estimators.ruling import Ruling, read_ruling
from laesi_tf.estimators.segmentation import NO_LEAF, Segmentation

METHOD = "ruling x silhouette"
FALLBACK = "regression, no ruling read"
_MARGIN_PX = 0.2
"""Standard deviation of the outline's place, in pixels of the network that finds it: seen on fresh scenes."""


class Reading:
    """Segmentation and ruling together; an area network decides between families of lines and stands in."""

    def __init__(self, segmentation: Segmentation, regression: Regression | None = None) -> None:
        self._segmentation = segmentation
        self._regression = regression

    def measure(self, image: np.ndarray, known: Known = NOTHING) -> Measurement:
        """As `Estimator.measure`; `known.grid_mm` is used, a known scale is not: the paper tells it."""
        mask = self._segmentation.silhouette(image)
        if not mask.any():
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        # The network learned its scale on millimetre paper; other paper would mislead it.
        adviser = self._regression if known.grid_mm == 1 else None
        about = None if adviser is None else adviser.px_per_mm(image)
        ruling = read_ruling(image, leaf=mask, grid_mm=known.grid_mm, about=about)
        if ruling is None:
            return self._without_ruling(image, mask, adviser)
        outline = trace(mask)
        area, middle = _area_cm2(mask, ruling)
        scale = ruling.px_per_mm(middle)
        leaf = Leaf(
            area_cm2=area,
            uncertainty_cm2=_uncertainty(
                area, outline, scale, ruling, max(mask.shape) / self._segmentation.side
            ),
            px_per_mm=scale,
            outline=outline,
        )
        return Measurement(method=METHOD, leaves=(leaf,), mask=mask, to_mm=ruling.forward)

    def _without_ruling(self, image: np.ndarray, mask: np.ndarray, adviser: Regression | None) -> Measurement:
        if adviser is None:
            refusal = "no ruling can be read; show bare, sharp paper around the leaf, or add an area model"
            leaf = Leaf(outline=trace(mask))
            return Measurement(method=METHOD, leaves=(leaf,), mask=mask, refusal=refusal)
        measured = adviser.measure(image)
        leaves = tuple(Leaf(area_cm2=leaf.area_cm2, outline=trace(mask)) for leaf in measured.leaves)
        return Measurement(method=FALLBACK, leaves=leaves, mask=mask, refusal=measured.refusal)


def _area_cm2(mask: np.ndarray, ruling: Ruling) -> tuple[float, np.ndarray]:
    """Area under `mask` [H, W] and the middle [2] of its pixels."""
    rows, columns = np.nonzero(mask)
    points = np.stack([columns, rows], axis=1) + 0.5
    return float(ruling.mm2_per_px(points).sum() / 100), points.mean(axis=0)


def _uncertainty(area: float, outline: np.ndarray, scale: float, ruling: Ruling, shrink: float) -> float:
    """Standard deviation of the area, cm2, from the outline's place and the scale's spread over patches."""
    length_mm = cv2.arcLength(outline.astype(np.float32), closed=True) / scale
    of_margin = length_mm * _MARGIN_PX * shrink / scale / 100
    of_scale = 2 * area * ruling.spread / math.sqrt(max(ruling.inliers, 1))
    return math.hypot(of_margin, of_scale)
