"""Bases of curves through evenly spaced nodes: a curve is its basis times the nodes' values."""

import numpy as np


def catmull_rom(controls: int, points: int) -> np.ndarray:
    """Return the basis [points, controls] of the interpolating cubic through evenly spaced control points."""
    position = np.linspace(0, controls - 1, points)
    left = np.minimum(position.astype(int), controls - 2)
    t = position - left
    cubic = np.array([[0, -0.5, 1, -0.5], [1, 0, -2.5, 1.5], [0, 0.5, 2, -1.5], [0, 0, -0.5, 0.5]])
    weights = cubic @ np.stack([t**0, t, t**2, t**3])
    basis = np.zeros((points, controls), np.float32)
    for offset in range(4):
        node = np.clip(left + offset - 1, 0, controls - 1)
        np.add.at(basis, (np.arange(points), node), weights[offset])
    return basis


def linear(nodes: int, points: int) -> np.ndarray:
    """Return the basis [points, nodes] of linear interpolation between evenly spaced nodes."""
    position = np.linspace(0, nodes - 1, points)[:, None]
    basis: np.ndarray = np.maximum(1 - np.abs(position - np.arange(nodes)), 0).astype(np.float32)
    return basis
