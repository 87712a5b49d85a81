"""A photo seen whole and from close up: cuts of it at no more pixels than are looked at.

The photo is shrunk once. A part is cut from that picture where it shows the part large enough, and from the
photo itself where it does not, so that no operation ever runs over 12 megapixels but the one that shrinks
them.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.data.letterbox import Letterbox, letterbox_image

OVERVIEW_SIDE_PX = 1536
"""Longer side of the picture that stands for the whole photo: 1 mm is at least 5 pixels in views up to 30
cm."""


@dataclass(frozen=True, eq=False)
class Crop:
    """A rectangle of a photo: `image`, uint8 [h, w, 3], begins at `origin` (x, y) in photo pixels.

    One of its pixels is `step` (x, y) photo pixels wide and high.
    """

    image: np.ndarray
    origin: np.ndarray
    step: np.ndarray

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """Photo pixels of `points` [..., 2], (x, y) in pixels of the cut, pixel centres at halves."""
        return points * self.step + self.origin

    def of_photo(self, points: np.ndarray) -> np.ndarray:
        """The inverse of `to_photo`."""
        return (points - self.origin) / self.step


class PhotoPyramid:
    """Cuts of one photo."""

    def __init__(self, photo: np.ndarray) -> None:
        """Take a photo, uint8 [H, W, 3]."""
        self.photo = Crop(photo, np.zeros(2), np.ones(2))
        self.whole = shrink(self.photo, OVERVIEW_SIDE_PX)
        self._fitted: dict[tuple[int, int], tuple[np.ndarray, Letterbox]] = {}

    @property
    def size(self) -> np.ndarray:
        """Width and height of the photo."""
        return np.array(self.photo.image.shape[1::-1])

    def fitted(self, size: tuple[int, int]) -> tuple[np.ndarray, Letterbox]:
        """`whole` in a network's input of `size` (h, w) by `fit`, once for all networks of a size."""
        if size not in self._fitted:
            self._fitted[size] = letterbox_image(self.whole.image, size)
        return self._fitted[size]

    def around(self, box: np.ndarray, *, at_least: int, at_most: int) -> Crop:
        """The part of the photo within `box` [[left, top], [right, bottom]], photo pixels.

        Its longer side has at most `at_most` pixels, and at least `at_least` where the photo has as many.
        """
        box = np.clip(box, 0, self.size)
        enough = (box[1] - box[0]).max() >= at_least * self.whole.step.max()
        return shrink(_crop(self.whole if enough else self.photo, box), at_most)


def shrink(cut: Crop, longest: int) -> Crop:
    """`cut` with its longer side brought down to `longest` pixels; as it is where it is no longer."""
    size = np.array(cut.image.shape[1::-1])
    if size.max() <= longest:
        return cut
    width, height = (int(side) for side in np.maximum(1, np.round(size * longest / size.max())))
    # The mean over each new pixel's square; OpenCV's is the fastest there is for large factors.
    small = cv2.resize(cut.image, (width, height), interpolation=cv2.INTER_AREA)
    return Crop(small, cut.origin, cut.step * size / [width, height])


def _crop(cut: Crop, box: np.ndarray) -> Crop:
    size = np.array(cut.image.shape[1::-1])
    (left, top), (right, bottom) = cut.of_photo(box)
    low = np.clip(np.floor([left, top]), 0, size - 1).astype(int)
    high = np.clip(np.ceil([right, bottom]), low + 1, size).astype(int)
    return Crop(cut.image[low[1] : high[1], low[0] : high[0]], cut.to_photo(low), cut.step)
