"""Leaf masks: MobileNetV3 with the Lite R-ASPP head of its paper (Howard et al., 2019, section 6.4)."""

import keras
import tensorflow as tf

from laesi_tf.models.backbone import features_at_stride

LOSSES = ("bce_dice", "bce")
_HEAD_CHANNELS = 128


def build_mask_network(base: keras.Model) -> keras.Model:
    """LR-ASPP on `base`: [B, H, W, 3] of 0..255 -> [B, H, W, 1], the probability that a pixel is leaf.

    Features are taken where a stride ends: 1/16 for meaning, 1/8 for detail, and 1/4, which the paper's head
    has not, for the margin: the area of a leaf hangs on where exactly it ends. The network is cut at 1/16
    rather than having its last stage dilated to 1/16 as the paper does: that stage tells a thousand classes
    apart and would cost four times as much at 1/16, while for a leaf on paper the pooled gate sees enough.
    The paper's 49x49 pooling of a 64x128 grid is global here: the grid of a 224 px picture is 14x14.
    """
    size = base.input_shape[1:3]
    deep, detail, margin = (features_at_stride(base, stride) for stride in (16, 8, 4))
    features = keras.layers.Conv2D(_HEAD_CHANNELS, 1, use_bias=False, name="head_conv")(deep)
    features = keras.layers.BatchNormalization(name="head_bn")(features)
    features = keras.layers.ReLU(name="head_relu")(features)
    gate = keras.layers.GlobalAveragePooling2D(keepdims=True, name="gate_pool")(deep)
    gate = keras.layers.Conv2D(_HEAD_CHANNELS, 1, use_bias=False, activation="sigmoid", name="gate")(gate)
    gated = keras.layers.Multiply(name="gated")([features, gate])
    gated = _resize(gated, detail.shape[1:3], "to_eighth")
    logits = keras.layers.Add(name="logits")(
        [
            keras.layers.Conv2D(1, 1, name="from_gated")(gated),
            keras.layers.Conv2D(1, 1, name="from_detail")(detail),
        ]
    )
    logits = _resize(logits, margin.shape[1:3], "to_quarter")
    logits = keras.layers.Add(name="sharper_logits")(
        [logits, keras.layers.Conv2D(1, 1, name="from_margin")(margin)]
    )
    output = keras.layers.Activation("sigmoid", name="leaf")(_resize(logits, size, "to_input"))
    return keras.Model(base.input, output, name="mask")


def mask_loss(output: tf.Tensor, mask: tf.Tensor, *, loss: str) -> tf.Tensor:
    """Mean loss, a scalar, of probabilities [B, H, W, 1] against 0/1 masks [B, H, W].

    "bce_dice" adds one minus the soft Dice overlap of each picture, so that small leaves weigh as much as
    large ones, as they do in mIoU.
    """
    truth = tf.cast(mask, tf.float32)
    leaf = tf.clip_by_value(output[..., 0], 1e-6, 1.0 - 1e-6)
    crossed = -tf.reduce_mean(truth * tf.math.log(leaf) + (1.0 - truth) * tf.math.log(1.0 - leaf))
    if loss == "bce":
        return crossed
    overlap = tf.reduce_sum(truth * leaf, axis=(1, 2))
    total = tf.reduce_sum(truth, axis=(1, 2)) + tf.reduce_sum(leaf, axis=(1, 2))
    # One pixel of slack: a picture without leaf has no overlap to divide by.
    return crossed + tf.reduce_mean(1.0 - (2.0 * overlap + 1.0) / (total + 1.0))


def _resize(features: keras.KerasTensor, size: tuple[int, int], name: str) -> keras.KerasTensor:
    return keras.layers.Resizing(*size, interpolation="bilinear", name=name)(features)
