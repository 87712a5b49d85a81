"""Resize a photo of any shape to a network's input without cropping, and resize masks back to the photo.

Networks are trained on scenes with square pixels, where the ruling of the paper tells the size of a pixel. So
a photo is scaled equally in both directions, never stretched, and never cropped, since a leaf may be
anywhere. The rest of the input is padded with the median colour of the photo's border: scenes have a plain
band beyond a straight edge where the sheet ends, while a repeated or mirrored border would smear or double a
leaf near it.

Downscaling averages over a triangle two output pixels wide, the antialiased bilinear filter for which scenes
attenuate their ruling, so that lines finer than a pixel fade in photos as they do in training.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from laesi_tf.common.arrays import FloatMap, Mask, Points, RgbImage
from laesi_tf.common.geometry import ImageSize


@dataclass(frozen=True, kw_only=True)
class Letterbox:
    """Position of a photo in a network's input, in pixels; points as in `common.geometry`."""

    photo_size: ImageSize
    input_size: ImageSize
    origin: tuple[int, int]
    """Upper left corner (x, y) of the photo in the input."""
    extent: ImageSize
    """Size of the photo in the input."""

    @property
    def scale(self) -> Points:
        """Input pixels per photo pixel (x, y); the two differ only by the rounding of `extent`."""
        return self.extent.xy / self.photo_size.xy

    def to_input_points(self, points: Points) -> Points:
        """Map `points` [..., 2] from the photo to the input."""
        return points * self.scale + self.origin

    def to_photo_points(self, points: Points) -> Points:
        """Map `points` [..., 2] from the input to the photo."""
        return (points - np.array(self.origin)) / self.scale

    def crop_and_resize_back(self, values: FloatMap) -> FloatMap:
        """Resample `values` [h, w] of the input to the photo: float32 [H, W]."""
        inside = np.asarray(values, np.float32)[self._slices()]
        return cv2.resize(inside, self.photo_size.xy.tolist(), interpolation=cv2.INTER_LINEAR)

    def pad(self, image: NDArray[np.uint8], colour: NDArray[np.uint8] | np.uint8) -> NDArray[np.uint8]:
        """Place `image` [height, width, ...] of size `extent` in an input that has `colour` elsewhere."""
        if self.extent == self.input_size:
            return image
        padded = np.empty((*self.input_size, *image.shape[2:]), image.dtype)
        padded[:] = colour
        padded[self._slices()] = image
        return padded

    def _slices(self) -> tuple[slice, slice]:
        """Rows and columns of the photo in the input."""
        (left, top), (height, width) = self.origin, self.extent
        return slice(top, top + height), slice(left, left + width)


def compute_letterbox(photo_size: tuple[int, int], input_size: tuple[int, int]) -> Letterbox:
    """Return the largest centred position of a photo in an input, sizes (height, width), without cropping."""
    photo, target = ImageSize(*photo_size), ImageSize(*input_size)
    scale = min(target.height / photo.height, target.width / photo.width)
    extent = ImageSize(*(max(1, round(side * scale)) for side in photo))
    origin = (target.width - extent.width) // 2, (target.height - extent.height) // 2
    return Letterbox(photo_size=photo, input_size=target, origin=origin, extent=extent)


def letterbox_image(image: RgbImage, size: tuple[int, int]) -> tuple[RgbImage, Letterbox]:
    """Resize `image`, uint8 [H, W, 3], to `size` (h, w): uint8 [h, w, 3] and its position there."""
    letterbox = compute_letterbox(ImageSize.of(image), size)
    small = _resize(image, letterbox.extent)
    return letterbox.pad(small, _border_median(small)), letterbox


def letterbox_mask(mask: Mask, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Resize `mask`, bool [H, W], to `size` as `letterbox_image` does: uint8 [h, w], 1 where half is leaf."""
    letterbox = compute_letterbox(ImageSize.of(mask), size)
    is_leaf = _resize(mask.astype(np.float32), letterbox.extent) >= 0.5
    return letterbox.pad(is_leaf.astype(np.uint8), np.uint8(0))


def _resize(image: NDArray[Any], extent: ImageSize) -> NDArray[Any]:
    return np.array(Image.fromarray(image).resize((extent.width, extent.height), Image.Resampling.BILINEAR))


def _border_median(image: RgbImage) -> NDArray[np.uint8]:
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    return np.median(border, axis=0).astype(np.uint8)
