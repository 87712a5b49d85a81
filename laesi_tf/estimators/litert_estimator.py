"""Measure with an exported LiteRT file: what an app does around it, in Python.

An app decodes the photo, shrinks it by area means into the upper left corner of a frame, calls `measure` and
draws what comes back. All that measures is in the file.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Points, RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo, sort_in_reading_order
from laesi_tf.estimators.leaf_outline import CUT_OFF, TOUCHED, PlacedMask, paint_masks
from laesi_tf.estimators.litert_file import LiteRtRunner, read_litert_file
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid, put_in_frame
from laesi_tf.estimators.ruling.codes import CUT_OFF as CUT_OFF_FLAG
from laesi_tf.estimators.ruling.codes import TOUCHED as TOUCHED_FLAG
from laesi_tf.estimators.ruling.codes import PitchNote, Refusal
from laesi_tf.estimators.ruling.judge import NOTES, SENTENCES
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.estimators.ruling_estimator import MOSTLY_UNCOUNTED, NO_LEAF_ON_SHEET, OFF_SHEET, UNCOUNTED

METHOD = "LiteRT: ruling x silhouette"
METHOD_KNOWN_SCALE = "LiteRT: silhouette x given scale"
METHOD_AREA = "LiteRT: regression"
_FLAGS = {CUT_OFF_FLAG: CUT_OFF, TOUCHED_FLAG: TOUCHED}
_OF_LEAVES = {
    Refusal.NO_LEAF: NO_LEAF,
    Refusal.NO_LEAF_ON_SHEET: NO_LEAF_ON_SHEET,
    Refusal.MOSTLY_UNCOUNTED: MOSTLY_UNCOUNTED,
}
"""What refusals say that are not of the ruling."""
_OUTLINE_PX = 2
"""Pixels of the mask that is traced per pixel of the network."""


class LiteRtEstimator:
    """Measures with a file of kind `photo`."""

    def __init__(self, model: bytes, *, reads_ruling: bool = True, threads: int = 1) -> None:
        """Take a graph; without `reads_ruling`, the scale that is given with a photo is used."""
        self._measure = LiteRtRunner(model, threads=threads)
        self._reads_ruling = reads_ruling

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; `info.px_per_mm` is used where no ruling is to be read."""
        overview = PhotoPyramid(image).overview
        step = float(np.sqrt(overview.pixel_size.prod()))
        known = 0.0 if self._reads_ruling or info.px_per_mm is None else info.px_per_mm / step
        result = self._measure(
            photo=put_in_frame(overview.image),
            size=np.array(overview.size, np.int32),
            grid_mm=np.float32(info.grid_mm or 0.0),
            px_per_mm=np.float32(known),
        )
        return _describe(result, image, overview, step, info, is_known=known > 0)


def _describe(
    result: dict[str, NDArray[Any]],
    image: RgbImage,
    overview: Crop,
    step: float,
    info: PhotoInfo,
    *,
    is_known: bool,
) -> Measurement:
    refusal = Refusal(int(result["refusal"]))
    leaves, masks, boxes = [], [], []
    for index in range(int(result["count"])):
        placed = _place_mask(result["mask"][index], result["square"][index], overview)
        leaf = _describe_leaf(result, index, step, placed, measured=refusal == Refusal.NONE)
        if leaf is not None:
            leaves.append(leaf)
            masks.append(placed)
            outline: Any = leaf.outline
            boxes.append([outline.min(axis=0), outline.max(axis=0)])
    order = sort_in_reading_order(np.array(boxes).reshape(-1, 2, 2))
    camera = None if is_known else _make_camera(result, overview)
    notes = [NOTES[PitchNote(int(result["note"]))]] if result["note"] else []
    if refusal == Refusal.NONE and result["beside"] > 0:
        notes.append(OFF_SHEET.format(count=int(result["beside"])))
    if refusal == Refusal.NONE and result["uncounted"] > 0:
        notes.append(UNCOUNTED.format(count=int(result["uncounted"])))
    text = _explain(refusal, result, step, info)
    if text is None and not leaves:
        text = NO_LEAF
    return Measurement(
        method=METHOD_KNOWN_SCALE if is_known else METHOD,
        leaves=tuple(leaves[index] for index in order),
        mask=paint_masks(masks, Crop(image, np.zeros(2), np.ones(2))),
        camera=camera,
        tilt_deg=None if camera is None else float(result["tilt_deg"]),
        note="; ".join(notes) or None,
        refusal=text,
    )


def _describe_leaf(
    result: dict[str, NDArray[Any]], index: int, step: float, placed: PlacedMask, *, measured: bool
) -> LeafMeasurement | None:
    """Return leaf `index`; None where its mask has no outline."""
    crop, mask = placed
    polygons = trace_polygons(mask)
    end = crop.to_photo(crop.size.xy.astype(float))
    if not polygons or (measured and not result["area_cm2"][index] > 0):
        return None
    outer, *holes = (crop.to_photo(ring) for ring in polygons[0].rings)
    values: dict[str, Any] = {}
    if measured:
        for name in ("area_cm2", "uncertainty_cm2", "length_mm", "width_mm"):
            values[name] = float(result[name][index])
        values["px_per_mm"] = float(result["leaf_px_per_mm"][index]) * step
    return LeafMeasurement(
        outline=np.clip(outer, crop.origin, end),
        holes=tuple(holes),
        note="; ".join(note for flag, note in _FLAGS.items() if result["flags"][index] & flag) or None,
        **values,
    )


def _place_mask(leaf: NDArray[np.uint8], square: Points, overview: Crop) -> PlacedMask:
    """Return the mask of a `leaf`, uint8 [s, s] of 0..255 in `square` (left, top, side in frame pixels), as
    far as it lies on the photo."""
    side = leaf.shape[0]
    wide = cv2.resize(leaf, (side * _OUTLINE_PX,) * 2, interpolation=cv2.INTER_LINEAR)
    pixel = float(square[2]) / len(wide)
    low = np.clip(np.ceil(-square[:2] / pixel - 1e-3), 0, len(wide) - 1).astype(int)
    high = np.floor((overview.size.xy - square[:2]) / pixel + 1e-3).astype(int)
    high = np.clip(high, low + 1, len(wide))
    mask = wide[low[1] : high[1], low[0] : high[0]] >= 128
    origin = overview.to_photo(np.maximum(square[:2] + low * pixel, 0))
    pixels: Any = np.broadcast_to(np.zeros(3, np.uint8), (*mask.shape, 3))
    end = overview.to_photo(overview.size.xy.astype(float))
    size = np.minimum(overview.pixel_size * pixel, (end - origin) / mask.shape[::-1])
    return Crop(pixels, origin, size), mask


def _make_camera(result: dict[str, NDArray[Any]], overview: Crop) -> SheetCamera | None:
    if not result["pitch_mm"] > 0:
        return None
    step_x, step_y = overview.pixel_size
    parameters = result["sheet"].astype(float)
    covariance = np.zeros((len(parameters),) * 2)
    size = overview.size.height, overview.size.width
    return SheetCamera(
        parameters, covariance, size, (float(step_x), float(step_y)), float(result["pitch_mm"])
    )


def _explain(refusal: Refusal, result: dict[str, NDArray[Any]], step: float, info: PhotoInfo) -> str | None:
    """Return the sentence of a refusal; None if there is none."""
    if refusal == Refusal.NONE:
        return None
    if refusal in _OF_LEAVES:
        return _OF_LEAVES[refusal].format(times=float(result["uncounted_share"]))
    text = SENTENCES[refusal].format(period=float(result["period_px"]) * step, grid=info.grid_mm)
    return text if result["count"] else f"{NO_LEAF}; {text}"


class LiteRtAreaEstimator:
    """Measures with a file of kind `area`: the area network alone, as in the paper."""

    def __init__(self, model: bytes, input_size: tuple[int, int], *, threads: int = 1) -> None:
        """Take a graph and the (height, width) of its input."""
        self._measure = LiteRtRunner(model, threads=threads)
        self._input_size = input_size

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`, one leaf; `info` is not used."""
        del info
        photo, _ = PhotoPyramid(image).letterbox_overview(self._input_size)
        area = float(self._measure(photo=photo)["area_cm2"])
        if not np.isfinite(area):
            return Measurement(method=METHOD_AREA, refusal="the area model's output is not finite")
        return Measurement(method=METHOD_AREA, leaves=(LeafMeasurement(area_cm2=area),))


def load_litert_estimator(path: Path, *, reads_ruling: bool = True) -> LiteRtEstimator | LiteRtAreaEstimator:
    """Load the estimator in an exported file. Raises InputError."""
    file = read_litert_file(path)
    kind = file.metadata.get("kind")
    if kind == "photo":
        return LiteRtEstimator(file.model, reads_ruling=reads_ruling)
    if kind == "area":
        height, width = file.metadata["input_size"]
        return LiteRtAreaEstimator(file.model, (height, width))
    raise InputError(f"{path} is a file of kind {kind!r}, which measures no photos")
