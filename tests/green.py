"""Stand-ins for trained networks: leaf is what is green, and 1 cm2 is a hundredth of the picture."""

from pathlib import Path

import keras
import numpy as np

from laesi_tf.common.run_files import BEST_MODEL_FILE, CONFIG_FILE
from laesi_tf.training import config_files
from laesi_tf.training.config import TrainConfig

LEAF, PAPER = (40, 160, 40), (240, 240, 240)


def mask_network(size: tuple[int, int]) -> keras.Model:
    """[B, h, w, 3] in 0..255 -> [B, h, w, 1]: near 1 where green exceeds the mean of red and blue by 60."""
    picture = keras.Input((*size, 3))
    finder = keras.layers.Conv2D(1, 1, activation="sigmoid")
    model = keras.Model(picture, finder(picture))
    finder.set_weights([np.reshape([-0.1, 0.2, -0.1], (1, 1, 3, 1)), np.array([-12.0])])
    return model


def area_network(size: tuple[int, int]) -> keras.Model:
    """[B, h, w, 3] in 0..255 -> [B, 1]: the percentage of green."""
    finder = mask_network(size)
    share = keras.layers.GlobalAveragePooling2D()(finder.output)
    return keras.Model(finder.inputs, keras.layers.Rescaling(100.0)(share))


def save_run(path: Path, task: str, *, size: tuple[int, int] = (64, 64)) -> Path:
    """Write a run directory as far as `load_run` reads it, with a stand-in network for `task`.

    Tests that load it need the fixture `stand_in_networks`.
    """
    path.mkdir(parents=True)
    config = TrainConfig(task=task, size=size, transform="none", alpha=STAND_IN_ALPHA)
    config_files.save_config(path / CONFIG_FILE, config, {})
    STAND_INS[task](size).save(path / BEST_MODEL_FILE)
    return path


STAND_INS = {"area": area_network, "mask": mask_network}
STAND_IN_ALPHA = 0.123
"""Width in the configuration of a run directory whose network is a stand-in."""


def photo(height: int, width: int, *, radius: float = 0.3) -> np.ndarray:
    """uint8 [height, width, 3]: a round leaf on paper, its radius in units of the shorter side."""
    return np.where(disk(height, width, radius=radius)[..., np.newaxis], LEAF, PAPER).astype(np.uint8)


def disk(height: int, width: int, *, radius: float = 0.3) -> np.ndarray:
    """bool [height, width]: the leaf of `photo`."""
    y, x = np.mgrid[:height, :width]
    distance = np.hypot(y - (height - 1) / 2, x - (width - 1) / 2)
    return distance <= radius * min(height, width)
