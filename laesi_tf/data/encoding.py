"""Encode images and masks as JPEG and PNG."""

import numpy as np
import tensorflow as tf

_JPEG_QUALITY = 95


def encode_jpeg(image: np.ndarray) -> bytes:
    """JPEG of an image uint8 [H, W, 3]: halved colour would blur the ruling's ink."""
    return tf.io.encode_jpeg(image, quality=_JPEG_QUALITY, chroma_downsampling=False).numpy()


def encode_png(field: np.ndarray) -> bytes:
    """PNG of a field uint8 [H, W]."""
    return tf.io.encode_png(field[..., None]).numpy()
