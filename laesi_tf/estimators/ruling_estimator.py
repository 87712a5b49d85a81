"""Measure each leaf as the area of its mask times the scale that is printed on the paper.

A mask network finds the leaves; the ruling tells how many mm2 each of their pixels covers, at any tilt,
through any lens. Where no ruling can be read the photo is refused, or, if that is asked for, an area network
guesses.
"""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.estimators.area_estimator import AreaEstimator
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.closer_reading import CloserReadingParams, read_around_largest
from laesi_tf.estimators.hidden_margin import HiddenMarginParams, add_hidden_margin
from laesi_tf.estimators.leaf_outline import UNCERTAINTY_SET, LeafOutline, paint_masks
from laesi_tf.estimators.mask_estimator import NO_LEAF, MaskEstimator, MaskEstimatorParams
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid
from laesi_tf.estimators.print_visibility import SET_ON
from laesi_tf.estimators.ruling.judge import SheetReading
from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.estimators.sheet_colour import SheetColour, SheetColourParams
from laesi_tf.estimators.sheet_map import UniformScale
from laesi_tf.estimators.uncounted_things import find_uncounted

METHOD = "ruling x silhouette"
GUESS = "regression, no ruling read"
GUESS_SCALE = "silhouette x scale of the area model, no ruling read"
ROUGH_ESTIMATE = "rough estimate of a network, because {reason}"
NO_GUESS = "the area model has no scale to guess several leaves with"
OFF_SHEET = "possible leaves beside the ruled sheet, not counted: {count}"
MOSTLY_UNCOUNTED = (
    "things on the sheet that have a leaf's colour are {times:.1f} times as large as what was outlined: look "
    "whether that is the whole leaf, and take other things away"
)
UNCOUNTED = "things on the sheet that have a leaf's colour, not counted: {count}"
NO_LEAF_ON_SHEET = "no leaf found on the lines that were read; lay one whole leaf on the ruled sheet"


@dataclass(frozen=True, kw_only=True)
class RulingEstimatorParams:
    """Parameters of masks, scale and uncertainty."""

    mask: MaskEstimatorParams = field(default_factory=MaskEstimatorParams)
    ruling: RulingReaderParams = field(default_factory=RulingReaderParams)
    closer: CloserReadingParams = field(default_factory=CloserReadingParams)
    sheet: SheetColourParams = field(default_factory=SheetColourParams)
    margin: HiddenMarginParams = field(default_factory=HiddenMarginParams)
    on_sheet: float = parameter(
        0.5, unit="share of the leaf", set_on="rendered (split develop) and cases, 2026-11-29"
    )
    """A leaf lies on the ruled part of a sheet with at least so much of its area."""
    most_uncounted: float = parameter(
        3.0,
        unit="area of the leaves",
        set_on=f"{SET_ON}: at most 1.8 where the leaf was outlined, 6.3 where a tip of it was",
    )
    """Where uncounted things of a leaf's colour are larger than this, a part of a leaf was outlined."""
    lift_mm: float = parameter(0.2, unit="mm", set_on="thickness of a fresh leaf that lies flat")
    """Height of the leaf's upper side above the paper."""
    lift_sd_mm: float = parameter(0.05, unit="mm", set_on=UNCERTAINTY_SET)
    """Standard deviation of this height, which no photo tells."""
    softness: float = parameter(4.0, unit="standard deviations", set_on=UNCERTAINTY_SET)
    """Standard deviation of the area per that which follows from the scale: where lines are hard to place, so
    are outlines."""
    guess_factor: float = parameter(
        1.4, unit="factor", set_on="rendered (split develop), area network of 2026-11-25; 2026-11-29"
    )
    """Factor within which two thirds of the area network's areas are."""

    def sheet_variance(self, area: Any, scale_error: Any, distance_mm: Any) -> Any:
        """Return the variance of `area` by scale and height of the leaf: numbers, or tensors of a graph.

        `scale_error` is relative, `distance_mm` the camera's.
        """
        # An area is proportional to the square of its scale, hence the factor of two.
        return (2 * area) ** 2 * ((self.softness * scale_error) ** 2 + (self.lift_sd_mm / distance_mm) ** 2)


class RulingEstimator:
    """Measures with a mask network and the ruling of the paper."""

    def __init__(
        self,
        mask_estimator: MaskEstimator,
        sheet_reader: SheetReader,
        *,
        guesser: AreaEstimator | None = None,
        params: RulingEstimatorParams | None = None,
    ) -> None:
        """Take what finds leaves and what reads rulings.

        Photos without a readable ruling are refused, unless a `guesser` is given. `params` replace those of
        `mask_estimator` and `sheet_reader`.
        """
        self.params = params or RulingEstimatorParams(mask=mask_estimator.params, ruling=sheet_reader.params)
        self._mask_estimator = mask_estimator.with_params(self.params.mask)
        self._sheet_reader = sheet_reader.with_params(self.params.ruling)
        self._guesser = guesser

    def with_params(self, params: RulingEstimatorParams) -> "RulingEstimator":
        """Return an estimator with the same networks and other parameters."""
        return RulingEstimator(self._mask_estimator, self._sheet_reader, guesser=self._guesser, params=params)

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; `info.grid_mm` is used, `info.px_per_mm` is not."""
        pyramid = PhotoPyramid(image)
        with ThreadPoolExecutor(1) as background:
            # A second core is free beside the mask network and the refinement of outlines.
            reading_sheet = background.submit(self._sheet_reader.read, pyramid.overview, grid_mm=info.grid_mm)
            candidates = self._mask_estimator.detect_leaves(pyramid)
            outlines = self._mask_estimator.outline_leaves(candidates, pyramid)
            sheet = reading_sheet.result()
        on_sheet = self._find_on_sheet(outlines, sheet, pyramid.overview)
        if not on_sheet:
            closer = read_around_largest(
                self._sheet_reader, outlines, sheet, pyramid, info.grid_mm, self.params.closer
            )
            if closer is not None:
                sheet, on_sheet = closer, self._find_on_sheet(outlines, closer, pyramid.overview)
        if sheet.camera is None:
            return self._measure_without_ruling(outlines, sheet, pyramid)
        off_sheet = [outline for outline in outlines if outline not in on_sheet]
        on_sheet = self._add_margins(on_sheet, off_sheet, sheet, pyramid)
        on_sheet = self._mask_estimator.add_petioles(on_sheet, pyramid)
        mask = paint_masks((outline.placed_mask for outline in on_sheet), pyramid.photo)
        counted, others = ([outline.polygon.outer for outline in part] for part in (on_sheet, off_sheet))
        uncounted = find_uncounted(pyramid, counted, others, sheet.outline, self.params.mask)
        refusal = None
        if not on_sheet:
            refusal = NO_LEAF_ON_SHEET if outlines else NO_LEAF
        elif uncounted.relative_area > self.params.most_uncounted:
            refusal = MOSTLY_UNCOUNTED.format(times=uncounted.relative_area)
        tilt_deg = sheet.camera.tilt_deg()
        if refusal is not None:
            return Measurement(
                method=METHOD,
                leaves=tuple(outline.without_scale() for outline in on_sheet or off_sheet),
                mask=mask,
                camera=sheet.camera,
                tilt_deg=tilt_deg,
                refusal=refusal,
            )
        notes = list(sheet.notes)
        if off_sheet:
            notes.append(OFF_SHEET.format(count=len(off_sheet)))
        if uncounted.number:
            notes.append(UNCOUNTED.format(count=uncounted.number))
        return Measurement(
            method=METHOD,
            leaves=tuple(self._measure_leaf(outline, sheet.camera) for outline in on_sheet),
            mask=mask,
            camera=sheet.camera,
            tilt_deg=tilt_deg,
            note="; ".join(notes) or None,
        )

    def _find_on_sheet(
        self, outlines: list[LeafOutline], sheet: SheetReading, overview: Crop
    ) -> list[LeafOutline]:
        """Return the leaves that lie on the sheet: none if none was read, or if the largest lies on something
        else within it."""
        ruled_part = sheet.outline
        if sheet.camera is None:
            return []
        if ruled_part is None or sheet.part is None or sheet.ruled_cells is None:
            return outlines
        params, leaves = self.params, [outline.polygon.outer for outline in outlines]
        colour = SheetColour(overview, sheet.part, sheet.ruled_cells, leaves, params.sheet)
        on_sheet: list[LeafOutline] = []
        for outline in sorted(outlines, key=lambda outline: -outline.area_px):
            leaf = outline.polygon.outer
            hull = cv2.convexHull(leaf.astype(np.float32))
            shared, _ = cv2.intersectConvexConvex(hull, ruled_part.astype(np.float32))
            is_within = shared >= params.on_sheet * cv2.contourArea(hull)
            likeness = colour.measure_likeness(leaf)
            if is_within and not (on_sheet or sheet.proves_millimetres) and colour.is_mostly_other(leaf):
                return []
            if is_within and not likeness < params.sheet.least_share_within:
                on_sheet.append(outline)
            elif is_within and not on_sheet:
                return []
            # A wedge of desk between the sheet and the photo's border is surrounded by paper, too.
            elif likeness >= params.sheet.least_share and not outline.is_cut_off:
                on_sheet.append(outline)
        return [outline for outline in outlines if outline in on_sheet]

    def _add_margins(
        self,
        on_sheet: list[LeafOutline],
        off_sheet: list[LeafOutline],
        sheet: SheetReading,
        pyramid: PhotoPyramid,
    ) -> list[LeafOutline]:
        """Return the leaves `on_sheet` with margins that have the paper's colour."""
        ruled_part, camera = sheet.outline, sheet.camera
        if ruled_part is None or camera is None:
            return on_sheet

        def add_margin(leaf: LeafOutline) -> LeafOutline:
            others = [other.polygon.outer for other in on_sheet + off_sheet if other is not leaf]
            return add_hidden_margin(leaf, others, ruled_part, camera, pyramid, self.params.margin)

        return [add_margin(leaf) for leaf in on_sheet]

    def _measure_leaf(self, outline: LeafOutline, camera: SheetCamera) -> LeafMeasurement:
        """Measure a leaf through the camera, corrected for its height above the paper."""
        middle = outline.centroid
        distance_mm = camera.distance_mm(middle)
        leaf = _shrink(outline.measure(camera), max(0.0, 1 - self.params.lift_mm / distance_mm))
        area = leaf.area_cm2
        assert area is not None and leaf.uncertainty_cm2 is not None
        of_sheet = self.params.sheet_variance(area, camera.scale_error(middle), distance_mm)
        uncertainty = math.sqrt(leaf.uncertainty_cm2**2 + of_sheet)
        return dataclasses.replace(leaf, uncertainty_cm2=uncertainty)

    def _measure_without_ruling(
        self, outlines: list[LeafOutline], sheet: SheetReading, pyramid: PhotoPyramid
    ) -> Measurement:
        """Refuse, or guess one leaf by the area network's area, several by its scale: it learned one leaf."""
        mask: Mask = paint_masks((outline.placed_mask for outline in outlines), pyramid.photo)
        bare = tuple(outline.without_scale() for outline in outlines)
        refused = Measurement(method=METHOD, leaves=bare, mask=mask, refusal=sheet.refusal)
        if not outlines:
            return dataclasses.replace(refused, refusal=f"{NO_LEAF}; {sheet.refusal}")
        if self._guesser is None:
            return refused
        prediction = self._guesser.predict_area(pyramid)
        leaves: tuple[LeafMeasurement, ...]
        if len(outlines) == 1 and math.isfinite(prediction.area_cm2):
            method, leaves = GUESS, (dataclasses.replace(bare[0], area_cm2=prediction.area_cm2),)
        elif prediction.px_per_mm is not None:
            scale = UniformScale(prediction.px_per_mm)
            method, leaves = GUESS_SCALE, tuple(outline.measure(scale) for outline in outlines)
        else:
            return dataclasses.replace(refused, refusal=f"{sheet.refusal}; {NO_GUESS}")
        share = self.params.guess_factor - 1
        return Measurement(
            method=method,
            leaves=tuple(
                dataclasses.replace(leaf, uncertainty_cm2=share * (leaf.area_cm2 or 0.0)) for leaf in leaves
            ),
            mask=mask,
            note=ROUGH_ESTIMATE.format(reason=sheet.refusal),
        )


def _shrink(leaf: LeafMeasurement, factor: float) -> LeafMeasurement:
    """Return a leaf's measures with its lengths times `factor`."""

    def scaled(value: float | None, power: int) -> float | None:
        return None if value is None else value * factor**power

    return dataclasses.replace(
        leaf,
        area_cm2=scaled(leaf.area_cm2, 2),
        holes_cm2=scaled(leaf.holes_cm2, 2),
        uncertainty_cm2=scaled(leaf.uncertainty_cm2, 2),
        length_mm=scaled(leaf.length_mm, 1),
        width_mm=scaled(leaf.width_mm, 1),
        perimeter_mm=scaled(leaf.perimeter_mm, 1),
    )
