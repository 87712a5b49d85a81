"""Measure each leaf as the area of its mask times a scale that the user gives."""

from collections.abc import Sequence

import keras
import numpy as np

from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo, sort_in_reading_order
from laesi_tf.estimators.leaf_detector import LeafCandidate, find_leaves
from laesi_tf.estimators.leaf_outline import LeafOutline, looks_like_pen, outline_leaf, paint_masks
from laesi_tf.estimators.leaf_shape import measure_polygon
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.models.inference import compile_inference

METHOD = "mask x given scale"
NO_LEAF = "no leaf found; show one whole leaf on the paper"
_LEAST_PX = 50.0
"""Photo pixels of which nothing can be told."""


class MaskEstimator:
    """The mask network of a run; it finds no scale itself and refuses the areas when none is given."""

    def __init__(self, model: keras.Model, size: tuple[int, int]) -> None:
        """Take a model [B, h, w, 3] in 0..255 -> leaf probability [B, h, w, 1]; `size` is (h, w)."""
        self._size = size
        self._predict = compile_inference(model, size)

    def measure(self, image: np.ndarray, known: PhotoInfo = UNKNOWN) -> Measurement:
        """As `Estimator.measure`; mask and outlines are given even where the areas are refused."""
        views = PhotoPyramid(image)
        outlines = self.outlines(views)
        mask = paint_masks((outline.part for outline in outlines), views.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if known.px_per_mm is None:
            leaves = tuple(LeafMeasurement(**outline.drawn()) for outline in outlines)
            refusal = "the scale is not known; give px_per_mm or use an area model"
            return Measurement(method=METHOD, leaves=leaves, mask=mask, refusal=refusal)
        to_mm = np.diag([1.0, 1.0, known.px_per_mm])
        leaves = tuple(outline.leaf(to_mm) for outline in outlines)
        return Measurement(method=METHOD, leaves=leaves, mask=mask)

    def outlines(self, views: PhotoPyramid) -> list[LeafOutline]:
        """The leaves on a photo in reading order."""
        return self.outlined(self.sights(views), views)

    def sights(self, views: PhotoPyramid) -> list[LeafCandidate]:
        """The leaves on a photo as the network sees them, coarsely."""
        return find_leaves(views, self._predict, self._size)

    def outlined(self, sights: Sequence[LeafCandidate], views: PhotoPyramid) -> list[LeafOutline]:
        """The leaves that were seen, at the photo's own resolution, in reading order."""
        found = [outline_leaf(sight, views.size) for sight in sights]
        outlines = [
            outline for outline in found if measure_polygon(outline.margin, outline.holes).area >= _LEAST_PX
        ]
        if len(outlines) > 1:
            outlines = [outline for outline in outlines if not looks_like_pen(outline.margin)] or outlines
        boxes = np.array([[one.margin.min(axis=0), one.margin.max(axis=0)] for one in outlines])
        return [outlines[index] for index in sort_in_reading_order(boxes.reshape(-1, 2, 2))]
