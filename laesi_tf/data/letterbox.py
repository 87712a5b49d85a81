"""A photo of any shape in a network's input of fixed shape, and the way back.

The networks learn from scenes with square pixels, where the ruling of the paper tells how large a pixel is.
So a photo is scaled alike in both directions and never stretched; and it is never cropped, since a leaf may
reach anywhere. What the photo does not cover is filled with the median colour along its border: a plain band
beyond a straight edge is what the synthesised scenes show where the sheet ends, while a repeated or mirrored
border would smear or double a leaf that lies near it.

Shrinking averages with a triangle of two new pixels' width, the antialiased bilinear filter for which the
scenes attenuate their ruling, so that lines finer than a pixel fade in photos as they do in training.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image


@dataclass(frozen=True, kw_only=True)
class Letterbox:
    """Where a photo lies in a network's input; all sizes and offsets in pixels."""

    photo_size: tuple[int, int]
    """Height and width of the photo."""
    input_size: tuple[int, int]
    """Height and width of the network's input."""
    offset: tuple[int, int]
    """Row and column of the photo's first pixel in the input."""
    extent: tuple[int, int]
    """Height and width of the photo in the input."""

    @property
    def scale(self) -> tuple[float, float]:
        """Input pixels per photo pixel, down and across; they differ only by the rounding of `extent`."""
        return self.extent[0] / self.photo_size[0], self.extent[1] / self.photo_size[1]

    def to_photo(self, values: np.ndarray) -> np.ndarray:
        """Resample `values` [h, w], which cover the input, to the photo: float32 [H, W]."""
        (top, left), (height, width) = self.offset, self.extent
        inside = np.asarray(values, np.float32)[top : top + height, left : left + width]
        return cv2.resize(inside, self.photo_size[::-1], interpolation=cv2.INTER_LINEAR)


def compute_letterbox(photo_size: tuple[int, int], input_size: tuple[int, int]) -> Letterbox:
    """The largest centred placement of a photo in an input, both (height, width), that crops nothing."""
    scale = min(inner / outer for inner, outer in zip(input_size, photo_size, strict=True))
    height, width = (max(1, round(side * scale)) for side in photo_size)
    offset = ((input_size[0] - height) // 2, (input_size[1] - width) // 2)
    return Letterbox(photo_size=photo_size, input_size=input_size, offset=offset, extent=(height, width))


def letterbox_image(image: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, Letterbox]:
    """Bring `image`, uint8 [H, W, 3], into `size` (h, w): uint8 [h, w, 3] and where the photo lies in it."""
    placement = compute_letterbox((image.shape[0], image.shape[1]), size)
    small = _resize(image, placement.extent)
    return _pad(small, placement, _border_median(small)), placement


def letterbox_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Bring `mask`, bool [H, W], into `size` as `fit` does: uint8 [h, w], 1 where half a pixel is leaf."""
    placement = compute_letterbox((mask.shape[0], mask.shape[1]), size)
    covered = _resize(mask.astype(np.float32), placement.extent) >= 0.5
    return _pad(covered.astype(np.uint8), placement, np.uint8(0))


def _resize(image: np.ndarray, extent: tuple[int, int]) -> np.ndarray:
    resized = Image.fromarray(image).resize(extent[::-1], Image.Resampling.BILINEAR)
    return np.array(resized)


def _border_median(image: np.ndarray) -> np.ndarray:
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    return np.median(border, axis=0).astype(np.uint8)


def _pad(image: np.ndarray, placement: Letterbox, colour: np.ndarray | np.uint8) -> np.ndarray:
    if placement.extent == placement.input_size:
        return image
    filled = np.empty((*placement.input_size, *image.shape[2:]), image.dtype)
    filled[:] = colour
    (top, left), (height, width) = placement.offset, placement.extent
    filled[top : top + height, left : left + width] = image
    return filled
