"""Encode images and masks as JPEG and PNG."""

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

_JPEG_QUALITY = 95


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encode an image uint8 [H, W, 3] without chroma subsampling, which would blur the ruling's colour."""
    return tf.io.encode_jpeg(image, quality=_JPEG_QUALITY, chroma_downsampling=False).numpy()


def encode_png_image(image: NDArray[np.uint8]) -> bytes:
    """Encode an image uint8 [H, W, 3] without loss."""
    return tf.io.encode_png(image).numpy()


def encode_png(plane: NDArray[np.uint8]) -> bytes:
    """Encode one plane uint8 [H, W]."""
    return tf.io.encode_png(plane[..., None]).numpy()
