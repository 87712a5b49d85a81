"""Copy-paste augmentation: several leaves in one image (Ghiasi et al., CVPR 2021).

A scene has one leaf; a photo may have more. The leaf of one image of a batch is pasted, smaller and turned,
onto another, with a shadow of its own. Masks become the union of both leaves.
"""

import math

import tensorflow as tf

from laesi_tf.data.augmentation_ops import warp_images
from laesi_tf.synthesis.ruling_crops import log_uniform

SCALE = (0.35, 1.0)
"""Size of the pasted leaf relative to its own image, log-uniform; beyond, it would be as soft as no photo."""
SHADOW_DARKNESS = (0.1, 0.5)
_SHADOW_SHARE = 1 / 32
"""Largest displacement and width of the shadow, in images."""


def paste_leaves(
    images: tf.Tensor, masks: tf.Tensor, *, seed: tf.Tensor, share: float
) -> tuple[tf.Tensor, tf.Tensor]:
    """Paste the leaf of the image half a batch away onto each of the first images, a `share` of the batch.

    Neighbours may show the same leaf in other light.

    `images` are uint8 [B, H, W, 3], `masks` uint8 [B, H, W] of 0 and 1, `seed` int [2]. Returns both, of the
    same types.
    """
    size = tf.shape(images)[0]
    count = tf.cast(tf.math.ceil(share * tf.cast(size, tf.float32)), tf.int32)
    donors = tf.roll(tf.concat([images, 255 * masks[..., None]], -1), -size // 2, 0)[:count]
    pasted, coverage = _paste(images[:count], tf.cast(donors, tf.float32), seed)
    union = tf.maximum(masks[:count], tf.cast(coverage > 0.5, masks.dtype))
    return tf.concat([pasted, images[count:]], 0), tf.concat([union, masks[count:]], 0)


def _paste(images: tf.Tensor, donors: tf.Tensor, seed: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """Return `images` [n, H, W, 3] with the leaves of `donors` [n, H, W, 4], and their coverage [n, H, W].

    The fourth channel of the donors is their mask, 0 or 255.
    """
    height, width = images.shape[1:3]
    size = tf.constant([width, height], tf.float32)
    numbers = tf.unstack(tf.random.stateless_uniform([7, tf.shape(images)[0]], seed))
    moved = warp_images(donors, _place_leaves(donors[..., 3], size, numbers[:4]))
    coverage = moved[..., 3] / 255
    reach = _SHADOW_SHARE * tf.reduce_max(size)
    shift = reach * (2 * tf.stack(numbers[4:6], 1) - 1)
    low, high = SHADOW_DARKNESS
    darkness = (low + (high - low) * numbers[6])[:, None, None] * _cast_shadow(coverage, shift)
    background = tf.cast(images, tf.float32) * (1 - darkness[..., None])
    result = background + coverage[..., None] * (moved[..., :3] - background)
    return tf.cast(result + 0.5, images.dtype), coverage


def _place_leaves(masks: tf.Tensor, size: tf.Tensor, numbers: list[tf.Tensor]) -> tf.Tensor:
    """Return affine matrices [B, 3, 3] from points of the result to those of the donors.

    The middle of each leaf of `masks` [B, H, W] gets to a random place of the result; `size` is (width,
    height).
    """
    total = tf.reduce_sum(masks, [1, 2]) + 1e-6
    middle_x = tf.reduce_sum(masks * (tf.range(size[0]) + 0.5), [1, 2]) / total
    middle_y = tf.reduce_sum(masks * (tf.range(size[1]) + 0.5)[:, None], [1, 2]) / total
    shrink = 1 / log_uniform(SCALE, numbers[0])
    angle = 2 * math.pi * numbers[1]
    c, s = shrink * tf.cos(angle), shrink * tf.sin(angle)
    place_x, place_y = numbers[2] * size[0], numbers[3] * size[1]
    return _stack_affine(
        [c, -s, middle_x - c * place_x + s * place_y], [s, c, middle_y - s * place_x - c * place_y]
    )


def _stack_affine(first_row: list[tf.Tensor], second_row: list[tf.Tensor]) -> tf.Tensor:
    """Return the affine matrices [B, 3, 3] of two rows of three numbers [B] each."""
    zero = tf.zeros_like(first_row[0])
    rows = (first_row, second_row, [zero, zero, zero + 1])
    return tf.stack([tf.stack(row, -1) for row in rows], -2)


def _cast_shadow(coverage: tf.Tensor, shift: tf.Tensor) -> tf.Tensor:
    """Return the shadow [B, H, W] of `coverage` [B, H, W], blurred and shifted by `shift` [B, 2] (x, y)."""
    width = max(3, math.ceil(_SHADOW_SHARE * max(coverage.shape[1:])))
    blurred = tf.nn.avg_pool2d(coverage[..., None], width, 1, "SAME")
    one, zero = tf.ones_like(shift[:, 0]), tf.zeros_like(shift[:, 0])
    moves = _stack_affine([one, zero, shift[:, 0]], [zero, one, shift[:, 1]])
    return warp_images(blurred, moves)[..., 0]
