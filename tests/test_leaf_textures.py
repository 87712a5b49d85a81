"""Reliefs of leaf photos."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tensorflow as tf
from PIL import Image
from scenes import difference, only

from laesi_tf.common.errors import InputError
from laesi_tf.data.leaf_textures import BRIGHTEST, DARKEST, load_textures
from laesi_tf.synthesis import synthesise

GREEN = np.array([60, 120, 40])
SIMPLE = only("surface")


def skin(side: int, *, depth: float = 0.2, shade: float = 0.0) -> np.ndarray:
    """A green surface [side, side, 3] with ridges, darker to the right by `shade`."""
    across = np.arange(side) + 0.5
    ridges = 1 + depth * np.sin(across[:, None] * 2 * np.pi / 16) * np.ones(side)
    light = 1 - shade * across / side
    return np.clip(GREEN * (ridges * light)[..., None], 0, 255)


def save(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(image).astype(np.uint8)).save(path)
    return path


def on_paper(leaf: np.ndarray, ground: tuple[int, int, int] = (240, 238, 230)) -> np.ndarray:
    image = np.full((300, 400, 3), ground, float)
    image[60 : 60 + len(leaf), 150 : 150 + len(leaf)] = leaf
    return image


def test_relief_is_kept_and_light_and_colour_are_not(tmp_path: Path) -> None:
    save(tmp_path / "leaf.png", skin(256, shade=0.6))
    (relief,) = load_textures(tmp_path, side=256)
    assert relief.shape == (256, 256, 3) and relief.dtype == np.float32
    np.testing.assert_allclose(relief.mean(axis=(0, 1)), 1, atol=0.02)
    expected = skin(256)[..., 1] / GREEN[1]
    within = np.s_[32:-32, 32:-32]
    np.testing.assert_allclose(relief[within][..., 1], expected[within], atol=0.1)


@pytest.mark.parametrize("ground", [(240, 238, 230), (120, 120, 120), (15, 15, 15), (235, 225, 190)])
def test_the_largest_square_of_leaf_is_found(tmp_path: Path, ground: tuple[int, int, int]) -> None:
    save(tmp_path / "leaf.png", on_paper(skin(160), ground))
    (relief,) = load_textures(tmp_path, side=64)
    # Paper within the square would be far brighter or darker than any ridge.
    assert relief.min() > 0.7 and relief.max() < 1.35


def test_strong_contrast_is_clipped(tmp_path: Path) -> None:
    save(tmp_path / "leaf.png", skin(256, depth=0.95))
    (relief,) = load_textures(tmp_path, side=256)
    assert relief.min() == np.float32(DARKEST) and relief.max() == np.float32(BRIGHTEST)


def test_bad_photos_are_named_and_skipped(tmp_path: Path) -> None:
    save(tmp_path / "a.png", skin(100))
    save(tmp_path / "b.png", np.full((100, 100, 3), 240.0))
    (tmp_path / "c.jpg").write_bytes(b"not an image")
    (tmp_path / "notes.txt").write_text("not looked at")
    save(tmp_path / "d.png", skin(120))
    with pytest.warns(UserWarning) as warned:
        assert len(load_textures(tmp_path, side=32)) == 2
    messages = [str(warning.message) for warning in warned]
    assert len(messages) == 2 and "b.png shows no leaf" in messages[0] and "c.jpg" in messages[1]


def test_limit_takes_the_first_by_name(tmp_path: Path) -> None:
    for name, depth in (("b", 0.3), ("a", 0.0), ("c", 0.3)):
        save(tmp_path / f"{name}.png", skin(100, depth=depth))
    (relief,) = load_textures(tmp_path, side=32, limit=1)
    assert np.ptp(relief) < 0.05


def test_folders_without_leaves(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        load_textures(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no photos"):
        load_textures(tmp_path)
    save(tmp_path / "paper.png", np.full((100, 100, 3), 240.0))
    with pytest.raises(InputError, match=r"none of the 1 photos.*paper\.png"):
        load_textures(tmp_path)


def draw(index: Any, textures: Any) -> tf.Tensor:
    return synthesise(2, size=(64, 64), ranges=SIMPLE, index=index, textures=textures)["image"]


@pytest.mark.parametrize("convert", [np.asarray, tf.constant, tf.Variable])
def test_arrays_tensors_and_variables_serve_as_textures_in_graphs(
    convert: Callable[[np.ndarray], Any],
) -> None:
    textures = convert(np.random.default_rng(0).uniform(0.5, 1.5, (2, 32, 32, 3)).astype(np.float32))
    render = tf.function(lambda index: draw(index, textures))
    expected = draw(4, tf.constant(textures))
    assert difference(render(tf.constant(4, tf.int64)), expected).max() <= 1


def test_textures_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="textures has shape"):
        synthesise(2, size=(64, 64), textures=np.ones((32, 32, 3), np.float32))


def test_textures_change_the_leaf_and_nothing_else() -> None:
    waves = 1 + 0.5 * np.sin(np.arange(64) / 2)[:, None, None] * np.ones((1, 64, 3))
    textures = tf.constant(waves[None], tf.float32)
    plain, textured = (
        synthesise(2, size=(64, 64), ranges=SIMPLE, index=0, textures=t) for t in (None, textures)
    )
    np.testing.assert_array_equal(plain["mask"], textured["mask"])
    apart = difference(plain["image"], textured["image"])
    leaf = plain["mask"].numpy() == 1
    assert apart[leaf].mean() > 2 and np.mean(apart[~leaf] > 1) < 0.1
