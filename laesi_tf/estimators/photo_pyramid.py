"""A photo at two resolutions, overview and original, and crops of it with no more pixels than needed.

The photo is shrunk once. A part is cropped from the overview where it has enough pixels there, and from the
photo itself where it does not, so that shrinking is the only operation on all of up to 200 megapixels.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Points, RgbImage
from laesi_tf.common.geometry import ImageSize, to_cv2_points
from laesi_tf.data.letterbox import Letterbox, letterbox_image
from laesi_tf.models.ruling_cells import FRAME_PX

OVERVIEW_SIDE_PX = FRAME_PX
"""Longer side of the overview: 1 mm is at least 5 pixels where the photo shows up to 30 cm."""


@dataclass(frozen=True, eq=False)
class Crop:
    """A rectangle of a photo, possibly shrunk."""

    image: RgbImage
    """uint8 [h, w, 3]."""
    origin: Points
    """Its upper left corner (x, y) in photo pixels."""
    pixel_size: Points
    """Width and height (x, y) of one of its pixels in photo pixels."""

    @property
    def size(self) -> ImageSize:
        """Height and width of `image`."""
        return ImageSize.of(self.image)

    def to_photo(self, points: Points) -> Points:
        """Map `points` [..., 2] from pixels of the crop to photo pixels."""
        return points * self.pixel_size + self.origin

    def from_photo(self, points: Points) -> Points:
        """Map `points` [..., 2] from photo pixels to pixels of the crop."""
        return (points - self.origin) / self.pixel_size

    def paint(self, outlines: Iterable[Points]) -> NDArray[np.uint8]:
        """Return 1 within `outlines`, each [n, 2] in photo pixels, else 0: uint8 [h, w]."""
        painted = np.zeros(self.size, np.uint8)
        # One by one: of outlines painted together, the overlap stays empty.
        for outline in outlines:
            cv2.fillPoly(painted, [to_cv2_points(self.from_photo(outline))], 1)
        return painted


class PhotoPyramid:
    """Overview and crops of one photo."""

    def __init__(self, image: RgbImage) -> None:
        """Take a photo, uint8 [H, W, 3]."""
        self.photo = Crop(image, np.zeros(2), np.ones(2))
        self.overview = shrink(self.photo, OVERVIEW_SIDE_PX)
        self._letterboxed: dict[tuple[int, int], tuple[RgbImage, Letterbox]] = {}

    @property
    def size(self) -> ImageSize:
        """Height and width of the photo."""
        return self.photo.size

    def letterbox_overview(self, size: tuple[int, int]) -> tuple[RgbImage, Letterbox]:
        """Return the overview in a network's input of `size` (height, width), made once per size."""
        if size not in self._letterboxed:
            self._letterboxed[size] = letterbox_image(self.overview.image, size)
        return self._letterboxed[size]

    def crop_around(self, box: Points, *, min_side: int, max_side: int) -> Crop:
        """Return the part of the photo within `box` [[left, top], [right, bottom]], photo pixels.

        Its longer side has at most `max_side` pixels, and at least `min_side` where the photo has as many.
        """
        box = np.clip(box, 0, self.size.xy)
        is_enough = (box[1] - box[0]).max() >= min_side * self.overview.pixel_size.max()
        return shrink(_crop(self.overview if is_enough else self.photo, box), max_side)


def shrink(crop: Crop, max_side: int) -> Crop:
    """Return `crop` with a longer side of at most `max_side` pixels."""
    size = crop.size.xy
    if size.max() <= max_side:
        return crop
    width, height = (int(side) for side in np.maximum(1, np.round(size * max_side / size.max())))
    # OpenCV's area average is the fastest filter for large factors.
    small = cv2.resize(crop.image, (width, height), interpolation=cv2.INTER_AREA)
    return Crop(small, crop.origin, crop.pixel_size * size / [width, height])


def put_in_frame(image: RgbImage) -> RgbImage:
    """Return `image`, uint8 [h, w, 3], in the upper left corner of a black frame."""
    frame = np.zeros((FRAME_PX, FRAME_PX, 3), np.uint8)
    frame[: image.shape[0], : image.shape[1]] = image
    return frame


def average_levels(frame: RgbImage, levels: int) -> list[NDArray[np.float32]]:
    """Return the means of `frame`, uint8 [F, F, 3], over squares of 2, 4, ... pixels, float32.

    All are exact in float32, so that they are those of `ruling.spectra.build_pyramid` in a graph.
    """
    rows = np.add(frame[0::2], frame[1::2], dtype=np.uint16)
    averaged = [np.add(rows[:, 0::2], rows[:, 1::2], dtype=np.float32)]
    averaged[0] *= 0.25
    for _ in range(levels - 1):
        side = len(averaged[-1]) // 2
        averaged.append(cv2.resize(averaged[-1], (side, side), interpolation=cv2.INTER_AREA))
    return averaged


def _crop(crop: Crop, box: Points) -> Crop:
    """Return the pixels of `crop` that `box` [2, 2], in photo pixels, touches."""
    size = crop.size.xy
    start, end = crop.from_photo(box)
    low = np.clip(np.floor(start), 0, size - 1).astype(int)
    high = np.clip(np.ceil(end), low + 1, size).astype(int)
    return Crop(crop.image[low[1] : high[1], low[0] : high[0]], crop.to_photo(low), crop.pixel_size)
