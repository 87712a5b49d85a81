"""Segment the leaf: MobileNetV3 with the Lite R-ASPP head of its paper (Howard et al., 2019, section 6.4)."""

import keras
import tensorflow as tf

from laesi_tf.models.backbone import features_at_stride

LOSSES = ("bce_dice", "bce")
_HEAD_CHANNELS = 128


def build_mask_network(base: keras.Model) -> keras.Model:
    """Add the LR-ASPP head to `base`: [B, H, W, 3] of 0..255 -> [B, H, W, 1], the probability of leaf.

    Features come from the last layer of a stride: 1/16 for context, 1/8 for detail, and 1/4, which the
    paper's head does not have, for the edge of the leaf, since the area depends on its exact position. The
    backbone ends at 1/16, while the paper dilates its last stage to 1/16: that stage distinguishes a thousand
    classes and would cost four times as much, and for a leaf on paper the pooled gate suffices. The paper's
    49x49 pooling of a 64x128 grid is global here: the grid of a 224 px image is 14x14.
    """
    size = base.input_shape[1:3]
    deep, detail, edge = (features_at_stride(base, stride) for stride in (16, 8, 4))
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
    logits = _resize(logits, edge.shape[1:3], "to_quarter")
    logits = keras.layers.Add(name="sharper_logits")(
        [logits, keras.layers.Conv2D(1, 1, name="from_margin")(edge)]
    )
    output = keras.layers.Activation("sigmoid", name="leaf")(_resize(logits, size, "to_input"))
    return keras.Model(base.input, output, name="mask")


def mask_loss(output: tf.Tensor, mask: tf.Tensor, *, loss: str) -> tf.Tensor:
    """Return the mean loss, a scalar, of probabilities [B, H, W, 1] for 0/1 masks [B, H, W].

    "bce" is binary cross-entropy. "bce_dice" adds one minus the soft Dice coefficient of each image, so that
    small leaves have the weight of large ones, as in mIoU.
    """
    truth = tf.cast(mask, tf.float32)
    leaf = tf.clip_by_value(output[..., 0], 1e-6, 1.0 - 1e-6)
    cross_entropy = -tf.reduce_mean(truth * tf.math.log(leaf) + (1.0 - truth) * tf.math.log(1.0 - leaf))
    if loss == "bce":
        return cross_entropy
    overlap = tf.reduce_sum(truth * leaf, axis=(1, 2))
    total = tf.reduce_sum(truth, axis=(1, 2)) + tf.reduce_sum(leaf, axis=(1, 2))
    # One pixel is added so that an image without leaf does not divide by zero.
    return cross_entropy + tf.reduce_mean(1.0 - (2.0 * overlap + 1.0) / (total + 1.0))


def _resize(features: keras.KerasTensor, size: tuple[int, int], name: str) -> keras.KerasTensor:
    return keras.layers.Resizing(*size, interpolation="bilinear", name=name)(features)
