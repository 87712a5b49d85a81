"""Scans of leaves of known area, drawn with noise, texture and shadows."""

import cv2
import numpy as np

DPI = 300
PX_PER_MM = DPI / 25.4
_FINER = 4
COLOURS = ((60, 110, 40), (90, 130, 60), (200, 190, 80), (130, 80, 40), (150, 60, 50))


def draw_scan(
    background: tuple[int, int, int],
    count: int,
    *,
    size_mm: tuple[float, float] = (70, 90),
    cloth: float = 0.0,
    shadow: float = 0.0,
    seed: int = 0,
) -> tuple[np.ndarray, list[float]]:
    """Return a scan, uint8 [H, W, 3], and the areas of its `count` leaves in cm2, in rows.

    `size_mm` is (height, width), `cloth` the standard deviation of the background's weave, `shadow` the share
    of light that is missing beside a leaf.
    """
    random = np.random.default_rng(seed)
    height, width = (int(side * PX_PER_MM) for side in size_mm)
    image = np.full((height, width, 3), background, np.float32)
    weave = cv2.GaussianBlur(random.normal(0, 1, (height, width)).astype(np.float32), (0, 0), 1.2)
    image += cloth * (weave / weave.std())[..., None]
    columns = int(np.ceil(np.sqrt(count * width / height)))
    cell = min(width / columns, height / -(-count // columns))
    areas = []
    for number in range(count):
        middle = (number % columns + 0.5) * cell, (number // columns + 0.5) * cell
        points = _leaf_outline(random, middle, cell * random.uniform(0.3, 0.42))
        x, y = (points - points[0]).T
        areas.append(float(abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)) / PX_PER_MM**2 / 100)
        # Leaf and shadow, without the rest of the scan.
        low = np.maximum(0, np.floor(points.min(0)).astype(int) - 16)
        high = np.minimum([width, height], np.ceil(points.max(0)).astype(int) + 16)
        part = image[low[1] : high[1], low[0] : high[0]]
        cover = fill(points - low, part.shape[:2])
        part *= 1 - shadow * cv2.GaussianBlur(np.roll(cover, (3, 3), (0, 1)), (0, 0), 4)[..., None]
        texture = cv2.GaussianBlur(random.normal(0, 60, part.shape[:2]).astype(np.float32), (0, 0), 3)
        colour = np.float32(COLOURS[number % len(COLOURS)]) + texture[..., None]
        cover = cv2.GaussianBlur(cover, (0, 0), 0.8)[..., None]
        part[:] = part * (1 - cover) + colour * cover
    return np.clip(image + random.normal(0, 2, image.shape), 0, 255).astype(np.uint8), areas


def fill(points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return how much of each pixel of an image of `size` (h, w) the polygon `points` [N, 2] covers."""
    large = np.zeros([side * _FINER for side in size], np.uint8)
    cv2.fillPoly(large, [np.round((points * _FINER - 0.5) * 16).astype(np.int32)], 255, shift=4)
    return cv2.resize(large, size[::-1], interpolation=cv2.INTER_AREA).astype(np.float32) / 255


def _leaf_outline(random: np.random.Generator, middle: tuple[float, float], length: float) -> np.ndarray:
    """Return the outline [N, 2] of a leaf, half as long as `length`, in any direction."""
    around = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    radius = length * (1 + random.choice([0, 0.12]) * np.cos(5 * around))
    x = radius * np.cos(around)
    y = radius * np.sin(around) * random.uniform(0.4, 0.8) * (1 - 0.3 * np.cos(around))
    turn = random.uniform(0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([middle[0] + c * x - s * y, middle[1] + s * x + c * y], 1)
