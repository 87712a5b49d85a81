"""Measure leaves on a scan at a given scale: by their colour on a plain background, else by a network."""

import dataclasses
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.geometry import ImageSize, Polygon, polygon_perimeter, trace_polygons
from laesi_tf.estimators.base import (
    UNKNOWN,
    LeafMeasurement,
    Measurement,
    PhotoInfo,
    sort_in_reading_order,
)
from laesi_tf.estimators.leaf_outline import LeafOutline, paint_masks
from laesi_tf.estimators.mask_estimator import NO_SCALE, MaskEstimator
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, shrink
from laesi_tf.estimators.scan.plain_background import (
    DRAWN_SCANS,
    PlainBackground,
    PlainBackgroundParams,
    fit_background,
)
from laesi_tf.estimators.scan.scan_objects import (
    ScanObject,
    ScanObjectParams,
    find_objects,
    has_one_colour,
    is_geometric,
    is_leaf_like,
    is_sheet_or_ruling,
)
from laesi_tf.estimators.scan.touching_leaves import TouchingLeavesParams, looks_like_several_leaves
from laesi_tf.estimators.sheet_map import UniformScale

METHOD = "colour on plain background x given scale"
NO_LEAF = "no leaf found on the plain background; lay leaves on it that differ from it in colour"
TOUCHING = "looks like several leaves that touch"
ONE_COLOUR = "a rectangle or disc of one colour: check that it is a leaf"
NOT_LEAVES = "objects that are no leaves by colour and shape, not counted: {count}"


@dataclass(frozen=True, kw_only=True)
class ScanEstimatorParams:
    """Parameters of the stages."""

    background: PlainBackgroundParams = field(default_factory=PlainBackgroundParams)
    objects: ScanObjectParams = field(default_factory=ScanObjectParams)
    touching: TouchingLeavesParams = field(default_factory=TouchingLeavesParams)
    working_px: int = parameter(45_000_000, unit="pixels", set_on="A4 at 600 dpi has 35 million")
    """A larger scan is shrunk to so many: it bounds the memory to 1 GB."""
    max_cut_off: float = parameter(0.7, unit="share of the objects' area", set_on="rendered, 2026-11-29")
    """With more, the objects are parts of a desk."""
    ragged_solidity: float = parameter(0.6, unit="share of the convex hull", set_on="semireal, 2026-11-29")
    """Objects of a smaller median are parts of a pattern, if they are many."""
    min_ragged: int = parameter(12, unit="objects", set_on="semireal, 2026-11-29")
    edge_sd_px: float = parameter(0.25, unit="pixels", set_on=DRAWN_SCANS)
    """Standard deviation of the position of an outline."""


class ScanEstimator:
    """Measures leaves on a plain background; leaves photos without one to a mask network."""

    def __init__(
        self, load_mask_estimator: Callable[[], MaskEstimator], params: ScanEstimatorParams | None = None
    ) -> None:
        """Take a function that loads the mask estimator, called for the first photo that needs it."""
        self.params = params or ScanEstimatorParams()
        self._load = load_mask_estimator
        self._loaded: MaskEstimator | None = None
        self._lock = threading.Lock()

    def with_params(self, params: ScanEstimatorParams) -> "ScanEstimator":
        """Return an estimator with other parameters."""
        return ScanEstimator(self._load_once, params)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; `info.px_per_mm` is needed."""
        background = fit_background(image, self.params.background)
        if background is None:
            return self._load_once().measure(image, info)
        if info.px_per_mm is None:
            return Measurement(method=METHOD, refusal=NO_SCALE)
        measurement = self._measure_objects(image, background, info.px_per_mm)
        return self._load_once().measure(image, info) if measurement is None else measurement

    def _load_once(self) -> MaskEstimator:
        with self._lock:
            if self._loaded is None:
                self._loaded = self._load()
            return self._loaded

    def _measure_objects(
        self, image: RgbImage, background: PlainBackground, px_per_mm: float
    ) -> Measurement | None:
        """Measure all objects that may be leaves; None if they show that the background is not plain."""
        photo = Crop(image, np.zeros(2), np.ones(2))
        size = ImageSize.of(image)
        factor = min(1.0, (self.params.working_px / (size.height * size.width)) ** 0.5)
        working = shrink(photo, max(1, int(max(size) * factor)))
        working_scale = px_per_mm / float(np.sqrt(working.pixel_size.prod()))
        outlines: list[tuple[LeafOutline, str | None]] = []
        others = 0
        for found in find_objects(working, background, self.params.objects, px_per_mm=working_scale):
            outline = self._outline(found)
            if outline is None:
                continue
            if is_sheet_or_ruling(found, outline.polygon.outer, working, self.params.objects):
                return None
            if not is_leaf_like(found, outline.polygon.outer, self.params.objects):
                others += 1
                continue
            outlines.append((outline, self._note(found, outline)))
        if self._looks_like_pattern([outline for outline, _ in outlines]):
            return None
        note = NOT_LEAVES.format(count=others) if others else None
        mask = paint_masks((outline.placed_mask for outline, _ in outlines), photo)
        if not outlines:
            refusal = "; ".join(filter(None, [NO_LEAF, note]))
            return Measurement(method=METHOD, mask=mask, refusal=refusal)
        contours = [outline.polygon.outer for outline, _ in outlines]
        boxes = np.array([[contour.min(axis=0), contour.max(axis=0)] for contour in contours])
        scale = UniformScale(px_per_mm)
        leaves = [_measure_leaf(*outlines[index], scale) for index in sort_in_reading_order(boxes)]
        return Measurement(method=METHOD, leaves=tuple(leaves), mask=mask, note=note)

    def _looks_like_pattern(self, outlines: list[LeafOutline]) -> bool:
        """Return whether the objects are parts of a pattern, such as that of a desk, rather than leaves.

        Most of their area is cut off by the border, or they are many and ragged.
        """
        areas = np.array([outline.area_px for outline in outlines])
        hulls = [cv2.contourArea(cv2.convexHull(o.polygon.outer.astype(np.float32))) for o in outlines]
        is_cut_off = np.array([outline.is_cut_off for outline in outlines], bool)
        params = self.params
        if len(outlines) > 1 and areas[is_cut_off].sum() > params.max_cut_off * areas.sum():
            return True
        is_ragged = (
            bool(np.median(areas / np.maximum(hulls, 1)) < params.ragged_solidity) if outlines else False
        )
        return is_ragged and len(outlines) > params.min_ragged

    def _outline(self, found: ScanObject) -> LeafOutline | None:
        polygons = trace_polygons(found.mask)
        if not polygons:
            return None
        outer, *holes = (found.crop.to_photo(ring) for ring in polygons[0].rings)
        sd = self.params.edge_sd_px * polygon_perimeter(polygons[0].outer)
        return LeafOutline(
            crop=found.crop,
            mask=found.mask,
            polygon=Polygon(outer, tuple(holes)),
            area_sd_px=float(sd * found.crop.pixel_size.prod()),
            edge_sd_mm=0.0,  # A lid presses leaves flat.
            is_cut_off=found.touches_border,
            is_touched=False,
        )

    def _note(self, found: ScanObject, outline: LeafOutline) -> str | None:
        """Return a reason to doubt that an object is one leaf."""
        if looks_like_several_leaves(found.mask, self.params.touching):
            return TOUCHING
        objects = self.params.objects
        if is_geometric(outline.polygon.outer, objects) and has_one_colour(found, objects):
            return ONE_COLOUR
        return None


def _measure_leaf(outline: LeafOutline, note: str | None, scale: UniformScale) -> LeafMeasurement:
    leaf = outline.measure(scale)
    return dataclasses.replace(leaf, note="; ".join(filter(None, [leaf.note, note])) or None)
