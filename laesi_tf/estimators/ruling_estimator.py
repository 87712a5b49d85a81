"""Measure each leaf as the area of its mask times the scale that is printed on the paper.

A mask network finds the leaves; the ruling tells how many mm2 each of their pixels covers, at any tilt. Where
no ruling can be read the area network's prediction is used instead, and the method says so.
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from laesi_tf.common.arrays import Homography, Mask, RgbImage
from laesi_tf.common.geometry import compute_px_per_mm
from laesi_tf.estimators.area_estimator import AreaEstimator, AreaPrediction
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.camera_fit import CameraParams, Ruling
from laesi_tf.estimators.leaf_outline import LeafOutline, coarse_mask, paint_masks
from laesi_tf.estimators.mask_estimator import NO_LEAF, MaskEstimator, MaskEstimatorParams
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling_reader.reader import read_ruling

METHOD = "ruling x silhouette"
FALLBACK = "regression, no ruling read"
FALLBACK_SCALE = "silhouette x scale of the area model, no ruling read"
LOW_CONFIDENCE = (
    "low confidence in the ruling: check in the overlay that the blue grid fits the printed lines"
)
ROUGH_ESTIMATE = "no ruling found: this is a rough network estimate"
_SHOW_MORE_PAPER = "show bare, sharp paper around the leaf"
_ADD_AREA_MODEL = f"{_SHOW_MORE_PAPER}, or add an area model"


@dataclass(frozen=True, kw_only=True)
class RulingEstimatorParams:
    """Parameters of masks, scale and uncertainty."""

    mask: MaskEstimatorParams = field(default_factory=MaskEstimatorParams)
    camera: CameraParams = field(default_factory=CameraParams)
    low_confidence: float = parameter(0.8, unit="probability")
    """A ruling with less confidence gets a note."""
    lift_mm: float = parameter(0.2, unit="mm", set_on="thickness of a fresh leaf that lies flat")
    """Height of the leaf's upper side above the paper."""
    lift_sd_mm: float = parameter(0.3, unit="mm", set_on="rise of a leaf between the points where it touches")
    """Standard deviation of this height, which no photo tells."""
    scale_sd: float = parameter(
        0.0011,
        unit="relative",
        set_on="semi-real photos of flat leaves: two thirds of the areas are within one standard deviation; "
        "2026-11-25",
    )
    """Standard deviation of the scale that remains with the clearest ruling."""
    area_network_sd: float = parameter(
        0.055,
        unit="relative",
        set_on="two thirds of semi-real photos with a visible ruling are within it, 2026-11-25",
    )
    """Standard deviation of the area network; without a visible ruling it is unknown, as the note says."""


class RulingEstimator:
    """Measures with a mask network and the ruling of the paper.

    An area network helps to decide which lines are the finest, and is used where no ruling can be read.
    """

    def __init__(
        self,
        mask_estimator: MaskEstimator,
        area_estimator: AreaEstimator | None = None,
        params: RulingEstimatorParams | None = None,
    ) -> None:
        """Take an estimator of masks and, optionally, one of areas; `params` replace those of the first."""
        self.params = params or RulingEstimatorParams(mask=mask_estimator.params)
        self._mask_estimator = mask_estimator.with_params(self.params.mask)
        self._area_estimator = area_estimator

    def with_params(self, params: RulingEstimatorParams) -> "RulingEstimator":
        """Return an estimator with the same networks and other parameters."""
        return RulingEstimator(self._mask_estimator, self._area_estimator, params)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; `info.grid_mm` is used, `info.px_per_mm` is not."""
        pyramid = PhotoPyramid(image)
        # The area network learned scales on millimetre paper and would mislead on any other.
        area_estimator = self._area_estimator if info.grid_mm == 1 else None
        with ThreadPoolExecutor(1) as background:
            # A second core is free beside the mask network, and beside the refinement of outlines.
            predicting = background.submit(_predict_area, area_estimator, pyramid)
            candidates = self._mask_estimator.detect_leaves(pyramid)
            prediction = predicting.result()
            leaf_mask = paint_masks(map(coarse_mask, candidates), pyramid.overview)
            reading = background.submit(_read_ruling, pyramid, leaf_mask, info.grid_mm, prediction)
            outlines = self._mask_estimator.outline_leaves(candidates, pyramid)
            ruling = reading.result()
        mask = paint_masks((outline.placed_mask for outline in outlines), pyramid.photo)
        if not outlines:
            return Measurement(method=METHOD, mask=mask, refusal=NO_LEAF)
        if ruling is None:
            advice = _SHOW_MORE_PAPER if area_estimator or info.grid_mm != 1 else _ADD_AREA_MODEL
            return self._fall_back_to_area_network(outlines, mask, prediction, advice)
        to_mm = ruling.to_mm @ np.diag([*(1 / pyramid.overview.pixel_size), 1.0])
        return Measurement(
            method=METHOD,
            leaves=tuple(self._measure_leaf(outline, to_mm, ruling, pyramid) for outline in outlines),
            mask=mask,
            to_mm=to_mm,
            tilt_deg=ruling.tilt_deg,
            note=LOW_CONFIDENCE if ruling.confidence < self.params.low_confidence else None,
        )

    def _measure_leaf(
        self, outline: LeafOutline, to_mm: Homography, ruling: Ruling, pyramid: PhotoPyramid
    ) -> LeafMeasurement:
        """Measure a leaf through the ruling's homography, corrected for its height above the paper."""
        params = self.params
        leaf = outline.measure(to_mm)
        assert leaf.area_cm2 is not None and leaf.uncertainty_cm2 is not None
        focal_px = params.camera.focal_length * max(pyramid.size)
        distance_mm = focal_px / compute_px_per_mm(to_mm, pyramid.size.xy / 2)
        area = leaf.area_cm2 * max(0.0, 1 - params.lift_mm / distance_mm) ** 2
        scale_sd = max(ruling.median_residual / math.sqrt(max(ruling.inliers, 1)), params.scale_sd)
        lift_sd = params.lift_sd_mm / distance_mm
        # An area is proportional to the square of its scale, hence the factor of two.
        uncertainty = math.hypot(leaf.uncertainty_cm2, 2 * area * scale_sd, 2 * area * lift_sd)
        return dataclasses.replace(leaf, area_cm2=area, uncertainty_cm2=uncertainty)

    def _fall_back_to_area_network(
        self, outlines: list[LeafOutline], mask: Mask, prediction: AreaPrediction | None, advice: str
    ) -> Measurement:
        """Measure one leaf by the network's area, several by its scale: it was trained on one leaf."""
        relative_sd = self.params.area_network_sd
        if prediction is not None and math.isfinite(prediction.area_cm2):
            if len(outlines) == 1:
                area = prediction.area_cm2
                leaf = dataclasses.replace(
                    outlines[0].without_scale(), area_cm2=area, uncertainty_cm2=relative_sd * area
                )
                return Measurement(method=FALLBACK, leaves=(leaf,), mask=mask, note=ROUGH_ESTIMATE)
            if prediction.px_per_mm is not None:
                to_mm = np.diag([1.0, 1.0, prediction.px_per_mm])
                measured = (outline.measure(to_mm) for outline in outlines)
                leaves = tuple(
                    dataclasses.replace(leaf, uncertainty_cm2=relative_sd * (leaf.area_cm2 or 0.0))
                    for leaf in measured
                )
                return Measurement(method=FALLBACK_SCALE, leaves=leaves, mask=mask, note=ROUGH_ESTIMATE)
        leaves = tuple(outline.without_scale() for outline in outlines)
        return Measurement(
            method=METHOD, leaves=leaves, mask=mask, refusal=f"no ruling can be read; {advice}"
        )


def _predict_area(estimator: AreaEstimator | None, pyramid: PhotoPyramid) -> AreaPrediction | None:
    return None if estimator is None else estimator.predict_area(pyramid)


def _read_ruling(
    pyramid: PhotoPyramid, leaf_mask: Mask, grid_mm: float, prediction: AreaPrediction | None
) -> Ruling | None:
    """Read the ruling in the overview outside `leaf_mask`, bool [h, w]; its homography is the overview's."""
    rough = None if prediction is None else prediction.px_per_mm
    overview = pyramid.overview
    return read_ruling(
        overview.image,
        leaf=leaf_mask,
        grid_mm=grid_mm,
        rough_px_per_mm=None if rough is None else rough / float(overview.pixel_size[0]),
    )
