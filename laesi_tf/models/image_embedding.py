"""Embed images with a network trained on ImageNet, so that the cosine of two features is a similarity."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.models.backbone import BACKBONES, FROM_SCRATCH, build_backbone, load_weights_file

RESNET = "resnet50"
NETWORKS = (RESNET, *BACKBONES)
_BATCH_SIZE = 32


@dataclass(frozen=True)
class ImageEmbedder:
    """A network without its classifier, and the origin of its weights."""

    infer: Callable[[tf.Tensor], tf.Tensor]
    origin: str

    def __call__(self, images: np.ndarray) -> np.ndarray:
        """Map `images` uint8 [N, H, W, 3] to features float32 [N, D] of unit length.

        A feature is the mean of the network's last feature map.
        """
        batches = np.split(images, range(_BATCH_SIZE, len(images), _BATCH_SIZE))
        features = np.concatenate([self.infer(tf.constant(batch, tf.float32)).numpy() for batch in batches])
        return features / np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-12)


def load_embedder(network: str, *, size: tuple[int, int], weights: str = "imagenet") -> ImageEmbedder:
    """Load the embedder `network`, one of NETWORKS, for images of `size` (height, width).

    `weights` is "imagenet" (Keras's own file, downloaded once) or the path of a file. Raises InputError for
    weights that are not available: features of an untrained network mean little.
    """
    if weights in (FROM_SCRATCH, "auto"):
        raise InputError(f"weights {weights!r} may be those of an untrained network; use imagenet or a file")
    if network == RESNET:
        base, origin = _build_resnet(size, weights)
        inputs = keras.Input((*size, 3))
        features = base(keras.applications.resnet50.preprocess_input(inputs))
    else:
        base, origin = build_backbone(network, size=size, weights=weights)
        inputs, features = base.input, base.output
    model = keras.Model(inputs, keras.layers.GlobalAveragePooling2D()(features))
    infer = tf.function(lambda images: model(images, training=False), [tf.TensorSpec([None, *size, 3])])
    return ImageEmbedder(infer, f"{network}, {origin}")


def _build_resnet(size: tuple[int, int], weights: str) -> tuple[keras.Model, str]:
    from_keras = weights == "imagenet"
    try:
        base = keras.applications.ResNet50(
            include_top=False, weights="imagenet" if from_keras else None, input_shape=(*size, 3)
        )
    except Exception as error:  # Keras wraps network errors in a bare Exception
        raise InputError(
            f"no ImageNet weights for {RESNET} ({str(error).splitlines()[0]}); "
            "pass --weights PATH of a file you have, or --network of one"
        ) from error
    return base, "imagenet, Keras" if from_keras else load_weights_file(base, Path(weights), "ResNet50")
