"""A stand-in for MobileNetV3, for tests of what is done with networks and not of the networks.

A training step of the real one takes 14 s of CPU to trace, one of this 3 s.
"""

import keras

from laesi_tf.models import backbone


def build_tiny_backbone(
    kind: str, size: tuple[int, int], alpha: float, weights: str | None = None
) -> keras.Model:
    """Build [B, H, W, 3] of 0..255 -> [B, H/32, W/32, C], with layers named as `features_at_stride` needs.

    Five strided convolutions with batch normalisation as in MobileNetV3, on squeezed inputs as there. "large"
    has twice the channels. Half a million weights, so that a leak of them shows. No `weights` of other
    networks fit.
    """
    assert weights is None, "the stand-in has random weights only"
    channels = 16 if kind == "small" else 32
    images = keras.Input((*size, 3))
    features = keras.layers.Rescaling(1 / 127.5, offset=-1)(images)
    for number, width in enumerate((channels, channels, channels, 2 * channels, 32 * channels)):
        if number:
            features = keras.layers.ZeroPadding2D(1, name=f"{number}_depthwise_pad")(features)
        features = keras.layers.Conv2D(
            max(1, round(alpha * width / 0.35)),
            3,
            strides=2,
            padding="valid" if number else "same",
            use_bias=False,
            name=f"{number}_conv",
        )(features)
        features = keras.layers.BatchNormalization(momentum=0.999, name=f"{number}_bn")(features)
        features = keras.layers.Activation("relu", name=f"{number}_relu")(features)
    return keras.Model(images, features, name=f"tiny_{kind}")


def install() -> None:
    """Let this process build the stand-in. For scripts; tests use the fixture `tiny_backbone`."""
    backbone._build_network = build_tiny_backbone
