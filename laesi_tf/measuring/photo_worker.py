"""Measure one photo: decode it, measure it, write its overlay, and return what the journal keeps."""

import math
import os
import threading
import traceback
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.result_files import OVERLAY_SIDE_PX
from laesi_tf.common.units import MM_PER_INCH
from laesi_tf.data.decoding import decode_photo, read_upright_size
from laesi_tf.data.file_resolution import read_dpi
from laesi_tf.estimators.base import UNKNOWN, Estimator, Measurement, PhotoInfo
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.measuring.journal import JournalEntry, read_file_state
from laesi_tf.measuring.photo_tasks import PhotoTask
from laesi_tf.reporting.html_page import encode_jpeg
from laesi_tf.reporting.leaf_records import LeafRecord, make_records
from laesi_tf.reporting.measurement_overlay import draw_comparison, draw_measurement
from laesi_tf.reporting.overlay import write_jpeg

_LARGE_PIXELS = 50_000_000
"""Photos of more pixels are measured one at a time: one of 200 megapixels takes 2 GB."""
_THUMBNAIL_SIDE_PX = 240
_THUMBNAIL_QUALITY = 70
_FAULT = "{photo} could not be measured by a fault of laesi_tf ({kind}: {error}); please report it"


@dataclass(frozen=True, kw_only=True)
class PhotoWorker:
    """Measures photos; called by several threads."""

    estimator: Estimator
    folder: Path
    """Where overlays are written."""
    info: PhotoInfo = UNKNOWN
    uses_dpi_of_file: bool = False
    """Whether each file's own resolution is the scale of its photo."""
    overlay_side: int | None = OVERLAY_SIDE_PX
    """Longer side of overlays in pixels; None for no overlays."""
    large_photo: threading.Lock = field(default_factory=threading.Lock)

    def measure(self, task: PhotoTask) -> JournalEntry:
        """Measure a photo; one that cannot be read becomes a record with an error.

        Raises InputError where the overlay cannot be written, and where the folder of the photo has vanished
        since it was listed: then the photos that follow cannot be read either.
        """
        state = read_file_state(task.page.path)
        is_large = _count_pixels(task) > _LARGE_PIXELS
        with self.large_photo if is_large else nullcontext():
            try:
                image = decode_photo(task.page.path, page=task.page.index)
            except InputError as error:
                _require_folder(task)
                record = LeafRecord(photo=str(task.page), error=str(error))
                return JournalEntry(key=task.key, state=state, records=(record,))
            try:
                info = self._find_scale(task)
            except InputError as error:
                record = LeafRecord(photo=str(task.page), refused=True, error=str(error))
                return JournalEntry(key=task.key, state=state, records=(record,))
            try:
                measurement = self.estimator.measure(image, info)
            # A fault of ours with one photo must not end the work on thousands.
            except Exception as error:
                traceback.print_exc()
                message = _FAULT.format(photo=task.page, kind=type(error).__name__, error=error)
                record = LeafRecord(photo=str(task.page), error=" ".join(message.split()))
                return JournalEntry(key=task.key, state=state, records=(record,))
            overlay = self._write_overlay(task, image, measurement)
            return JournalEntry(
                key=task.key,
                state=state,
                records=_make_records(task, measurement, overlay),
                overlay_side=self.overlay_side,
                thumbnail=_draw_thumbnail(image, measurement),
            )

    def _find_scale(self, task: PhotoTask) -> PhotoInfo:
        """Return what is known of the photo. Raises InputError if its file states no scale and must."""
        if not self.uses_dpi_of_file:
            return self.info
        dpi = read_dpi(task.page.path, page=task.page.index)
        return PhotoInfo(px_per_mm=dpi / MM_PER_INCH, grid_mm=self.info.grid_mm)

    def _write_overlay(self, task: PhotoTask, image: RgbImage, measurement: Measurement) -> str | None:
        if self.overlay_side is None:
            return None
        drawn = draw_measurement(image, measurement, task.page.name, side=self.overlay_side)
        write_jpeg(self.folder / task.overlay, drawn)
        return task.overlay


def _make_records(task: PhotoTask, measurement: Measurement, overlay: str | None) -> tuple[LeafRecord, ...]:
    records = make_records(str(task.page), measurement, overlay)
    nothing = LeafRecord(
        photo=str(task.page), method=measurement.method, refused=True, error=NO_LEAF, overlay=overlay
    )
    return tuple(records) or (nothing,)


def _draw_thumbnail(image: RgbImage, measurement: Measurement) -> str:
    """Return a small JPEG with the outlines in base64."""
    drawn = draw_comparison(image, measurement, None, side=_THUMBNAIL_SIDE_PX)
    return encode_jpeg(drawn, _THUMBNAIL_QUALITY)


def _count_pixels(task: PhotoTask) -> int:
    """Return the pixels of a photo by its header; 0 where it cannot be read, which decoding reports."""
    try:
        return math.prod(read_upright_size(task.page.path))
    except InputError:
        return 0


def _require_folder(task: PhotoTask) -> None:
    """Raise InputError if the photo was there when it was listed, and its folder is gone or empty now."""
    folder = task.page.path.parent
    if task.state is None or read_file_state(task.page.path) is not None:
        return
    try:
        with os.scandir(folder) as entries:
            is_empty = next(entries, None) is None
    except OSError:
        is_empty = True
    if is_empty:
        raise InputError(
            f"the photos in {folder} have vanished; connect the drive, then run the command again"
        )
