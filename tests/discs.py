"""Stand-in scenes that a network learns in seconds: a disc on paper, its area known."""

from collections.abc import Iterator

import numpy as np
import tensorflow as tf


def stream(
    *, task: str, batch_size: int, size: int, start: int = 0, count: int | None = None
) -> tf.data.Dataset:
    """Return batches (image uint8 [B, S, S, 3], target); image i depends only on i."""

    def samples() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        index = start
        while count is None or index < start + count:
            image, mask = disc(index, size)
            fraction = mask.mean()
            yield image, mask if task == "mask" else np.float32([100.0 * fraction + 1.0, np.nan, fraction])
            index += 1

    target = tf.TensorSpec([size, size], tf.uint8) if task == "mask" else tf.TensorSpec([3], tf.float32)
    signature = (tf.TensorSpec([size, size, 3], tf.uint8), target)
    return tf.data.Dataset.from_generator(samples, output_signature=signature).batch(batch_size)


def disc(index: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return image uint8 [S, S, 3] and mask uint8 [S, S] of a dark green disc on noisy white."""
    random = np.random.default_rng(index)
    radius = size * random.uniform(0.12, 0.35)
    across, down = random.uniform(radius, size - radius, 2)
    rows, columns = np.mgrid[:size, :size] + 0.5
    mask = ((rows - down) ** 2 + (columns - across) ** 2 < radius**2).astype(np.uint8)
    image = np.where(mask[..., None] > 0, (40, 110, 30), (225, 225, 220))
    return np.clip(image + random.normal(0, 8, image.shape), 0, 255).astype(np.uint8), mask
