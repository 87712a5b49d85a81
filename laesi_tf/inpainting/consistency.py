"""Compare what a repainted image shows with its mask.

Paper, section "Integration of ControlNet Inpainting": a MobileNet segments each image, and those whose mask
deviates by more than 15 % from the true one are dropped.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.run_files import PRETRAINED
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.keras_networks import load_run_of
from laesi_tf.models.inference import compile_inference

_PROBABILITY = 0.5


class LeafSegmenter:
    """The mask network of a run, or the one that comes with the package, applied to whole images.

    Images of a data set show one leaf of suitable size, so none of the searching at several scales is needed
    that a photo needs, and the network's mask is compared as it is, without any correction.
    """

    def __init__(self, run: Path | None = None) -> None:
        """Load the network. Raises InputError if `run` is no run of task mask."""
        loaded = load_run_of("mask", run or PRETRAINED / "mask")
        self._size = loaded.spec.size
        self._predict = compile_inference(loaded.model, self._size)

    def segment(self, images: Sequence[RgbImage]) -> list[Mask]:
        """Return the leaf, bool [H, W], on each of `images`, uint8 [H, W, 3]."""
        boxed, letterboxes = zip(*(letterbox_image(image, self._size) for image in images), strict=True)
        probabilities = self._predict(np.stack(boxed))[..., 0]
        return [
            letterbox.crop_and_resize_back(probability) > _PROBABILITY
            for letterbox, probability in zip(letterboxes, probabilities, strict=True)
        ]


def mask_deviation(found: NDArray[np.bool_], true: NDArray[np.bool_]) -> float:
    """Return the number of pixels in which two masks [H, W] differ, divided by the leaf's pixels in `true`.

    The paper does not define its deviation. A difference of areas, as in its mask pixel error, would not see
    a leaf that has moved, since it loses on one side what it gains on the other. The intersection over union
    would, but it is no share of the leaf: 15 % of wrong pixels are an IoU anywhere from 0.85 to 0.87. This
    measure is never below the relative error of the area, so that no accepted image has a label that is wrong
    by more than the limit. It is 0 for equal masks, 1 where no leaf is found, and above 1 where more is found
    outside than there is leaf. `true` must not be empty.
    """
    return float(np.count_nonzero(found != true) / np.count_nonzero(true))
