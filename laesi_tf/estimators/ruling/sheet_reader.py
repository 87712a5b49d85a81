"""Read the ruling of a photo: from pixels to a camera, or to a refusal.

All that looks at pixels is in the stages, TensorFlow functions or the LiteRT file converted from them. Only a
photo whose lines are too fine for the half resolution is looked at in full: three quarters of the network's
work is there.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, Points, RgbImage
from laesi_tf.estimators.photo_pyramid import Crop, average_levels, put_in_frame
from laesi_tf.estimators.ruling.judge import SheetReading, judge_verdict
from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.models.ruling_cells import CELL_PX, FRAME_CELLS, FRAME_PX, LEVELS

_USED_PX = (FRAME_PX // 2, FRAME_PX * 3 // 4, FRAME_PX)
"""Sides of the part of the frame that the network sees."""
_LARGEST_PX = 750_000
"""Pixels of an image that the network sees at once."""
_REACH_PX = 160
"""Distance from which the network's answer for a cell does not depend on the image; a multiple of CELL_PX."""


class RulingStages(Protocol):
    """What looks at pixels; shapes and units are those of `ruling_graph.RulingGraph`."""

    def with_params(self, params: RulingReaderParams) -> "RulingStages":
        """Return the same stages with other parameters."""
        ...

    def ask_network(self, images: Any) -> Any:
        """Return the network's logits for the cells of images."""
        ...

    def needs_full_resolution(self, coarse: Sequence[Any], size: Any) -> Any:
        """Return whether the logits of the coarser levels do not suffice."""
        ...

    def read(
        self,
        frame: RgbImage,
        coarser: Any,
        logits: Sequence[Any],
        size: Any,
        is_full: Any,
        grid_mm: Any,
    ) -> dict[str, Any]:
        """Return the verdict, see `verdict.state_verdict`."""
        ...


class SheetReader:
    """Reads rulings with the stages of a trained network."""

    def __init__(self, stages: RulingStages, params: RulingReaderParams | None = None) -> None:
        """Take the stages; `params` replace theirs."""
        self.params = params or RulingReaderParams()
        self._stages = stages.with_params(self.params)

    def with_params(self, params: RulingReaderParams) -> "SheetReader":
        """Return a reader with the same network and other parameters."""
        changed = copy.copy(self)
        changed.params = params
        changed._stages = self._stages.with_params(params)
        return changed

    def read(self, part: Crop, *, grid_mm: float | None) -> SheetReading:
        """Read the ruling of a photo in its overview or another `part`, of at most FRAME_PX pixels.

        `grid_mm` is the distance of the finest lines where the user names it. The camera maps photo pixels;
        its focal length is that of a photo of which `part` shows the whole.
        """
        height, width = part.size
        verdict = self._read_frame(put_in_frame(part.image), (height, width), grid_mm)
        step_x, step_y = part.pixel_size
        judged = judge_verdict(
            verdict,
            (height, width),
            (float(step_x), float(step_y)),
            grid_mm=grid_mm,
            scale_error=self.params.judge.scale_error,
        )
        camera = judged.camera
        if camera is not None:
            left, top = part.origin
            camera = replace(camera, origin=(float(left), float(top)))
        cells = verdict["agreement"] > self.params.sheet_agreement
        outline = outline_sheet(cells, part)
        return replace(judged, camera=camera, outline=outline, part=part, ruled_cells=cells)

    def _read_frame(
        self, frame: RgbImage, size: tuple[int, int], grid_mm: float | None
    ) -> dict[str, np.ndarray]:
        """Return the verdict on the photo of `size` (height, width) in the upper left corner of `frame`."""
        used = [_round_up(side) for side in size]
        levels = average_levels(frame, LEVELS - 1)

        def ask(level: int, image: np.ndarray) -> np.ndarray:
            return _fill_level(self._ask_in_parts(image[: used[0] >> level, : used[1] >> level]), level)

        coarse = [ask(level, image) for level, image in enumerate(levels, 1)]
        frame_size = np.array(size, np.float32)
        is_full = np.bool_(self._stages.needs_full_resolution(coarse, frame_size))
        full = ask(0, frame) if is_full else _fill_level(coarse[0][:0], 0)
        coarser = np.concatenate([image.reshape(-1, 3) for image in levels])
        del levels  # 9 MB that the reading need not have beside it
        verdict = self._stages.read(
            frame, coarser, [full, *coarse], frame_size, is_full, np.float32(grid_mm or 0.0)
        )
        return {name: np.asarray(value) for name, value in verdict.items()}

    def _ask_in_parts(self, image: np.ndarray) -> np.ndarray:
        """Return the logits for `image` [h, w, 3]; of a large one, in two parts that overlap by the network's
        reach: it needs 120 bytes per pixel."""
        if image.size <= _LARGEST_PX * 3:
            return np.asarray(self._stages.ask_network(image[np.newaxis].astype(np.float32)))[0]
        axis = int(np.argmax(image.shape[:2]))
        half = image.shape[axis] // (2 * CELL_PX) * CELL_PX
        before, after = (
            self._ask_in_parts(image[start:end] if axis == 0 else image[:, start:end])
            for start, end in ((0, half + _REACH_PX), (half - _REACH_PX, image.shape[axis]))
        )
        kept = np.split(before, [half // CELL_PX], axis)[0], np.split(after, [_REACH_PX // CELL_PX], axis)[1]
        return np.concatenate(kept, axis)


def _fill_level(logits: np.ndarray, level: int) -> np.ndarray:
    """Return `logits` [h, w, CHANNELS] in the corner of zeros for all cells of a level of the frame."""
    filled = np.zeros((FRAME_CELLS >> level, FRAME_CELLS >> level, logits.shape[-1]), np.float32)
    filled[: logits.shape[0], : logits.shape[1]] = logits
    return filled


def _round_up(side: int) -> int:
    """Return the smallest of `_USED_PX` that holds `side` pixels: few sizes, as each is compiled."""
    return next(size for size in _USED_PX if size >= side)


def outline_sheet(cells: Mask, part: Crop) -> Points | None:
    """Return the convex outline [N, 2], photo pixels, of `cells` that show the ruling; None without any.

    `cells` are bool [C, C], of CELL_PX pixels of `part`.
    """
    rows, columns = np.nonzero(cells)
    if len(rows) < 3:
        return None
    corners = np.concatenate([np.stack([columns + i, rows + j], 1) for i in (0, 1) for j in (0, 1)])
    hull = cv2.convexHull(corners.astype(np.float32) * CELL_PX)[:, 0]
    return part.to_photo(np.minimum(hull, part.size.xy))
