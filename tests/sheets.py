"""Millimetre paper drawn line by line, its homography known."""

import math

import numpy as np

SIDE = 600
FINER = 3


def drawn(
    *, px_per_mm: float, turn: float, tilt: tuple[float, float] = (0.0, 0.0), heavy: int = 5, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """A sheet, uint8 [SIDE, SIDE, 3], and its homography [3, 3] from pixels to mm."""
    cosine, sine = math.cos(turn) / px_per_mm, math.sin(turn) / px_per_mm
    centred = np.array([[1, 0, -SIDE / 2], [0, 1, -SIDE / 2], [0, 0, 1]])
    rates = np.array([[cosine, sine, 0], [-sine, cosine, 0], [tilt[0] / SIDE, tilt[1] / SIDE, 1]])
    forward = rates @ centred
    # Pixels integrate: thin lines sampled at points would beat with the pixels and print lines of their own.
    y, x = (np.mgrid[: SIDE * FINER, : SIDE * FINER] + 0.5) / FINER
    u, v, w = np.tensordot(forward, np.stack([x, y, np.ones_like(x)]), axes=1)
    ink = np.zeros_like(x)
    for position in (u / w, v / w):
        for pitch, strength in ((1, 60), (heavy, 110)):
            distance = np.abs((position + pitch / 2) % pitch - pitch / 2)
            ink = np.maximum(ink, strength * np.exp(-((distance / 0.12) ** 2)))
    ink = ink.reshape(SIDE, FINER, SIDE, FINER).mean(axis=(1, 3))
    noise = np.random.default_rng(seed).normal(0, 4, (SIDE, SIDE))
    grey = np.clip(225 - ink + noise, 0, 255)
    return np.stack([grey, np.clip(grey + ink * 0.5, 0, 255), grey], axis=-1).astype(np.uint8), forward


def jacobian(forward: np.ndarray, point: np.ndarray) -> float:
    return abs(np.linalg.det(forward)) / abs(forward[2] @ [*point, 1]) ** 3
