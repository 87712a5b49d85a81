"""Scenes with chosen numbers, and comparisons of pictures. For tests of synthesis only."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import COMPONENTS, Ranges, load_ranges, rasterizer
from laesi_tf.synthesis.presets import enable_all_components
from laesi_tf.synthesis.ranges import Probability, fields_of

ROOMS = ("paper", "surface", "light", "props", "camera", "desk")
RENDERING_2 = load_ranges("rendering_2")


def middle(room: Any, **given: float | bool) -> Any:
    """`room` with each range's middle as a scalar tensor and each Chance False, but for what is `given`."""
    return dataclasses.replace(
        room, **{name: tf.constant(given.get(name, _middle(spec))) for name, spec in fields_of(room).items()}
    )


def _middle(spec: Any) -> float | bool:
    return False if isinstance(spec, Probability) else float(np.mean(spec))


def bounds(spec: Any) -> tuple[float, float]:
    """Lowest and highest number that a range can give; 0 and 1 stand for False and True."""
    if isinstance(spec, Probability):
        return 0.0, 1.0
    return spec if isinstance(spec, tuple) else (spec, spec)


def changed(ranges: Ranges, room: str, **fields: Any) -> Ranges:
    """`ranges` with other `fields` in one room."""
    return dataclasses.replace(ranges, **{room: dataclasses.replace(getattr(ranges, room), **fields)})


def only(*components: str, ranges: Ranges = RENDERING_2) -> Ranges:
    """`ranges` with no more than these components."""
    return dataclasses.replace(ranges, without=frozenset(COMPONENTS) - frozenset(components))


def complete(ranges: Ranges = RENDERING_2) -> Ranges:
    """`ranges` with every component in every picture, the red square too, each leaf in one light."""
    return enable_all_components(changed(ranges.with_passes(1), "props", calibration=Probability(0.5)))


def specs(ranges: Ranges) -> Iterator[tuple[str, str, Any]]:
    """(room, field, range) of all that a scene is drawn from, kinds of leaves as `leaf.oak`."""
    rooms = {room: getattr(ranges, room) for room in ROOMS}
    kinds = {f"leaf.{name}": kind for name, (_, kind) in ranges.leaf.items()}
    for room, values in (rooms | kinds).items():
        for field, spec in fields_of(values).items():
            yield room, field, spec


def difference(one: tf.Tensor, other: tf.Tensor) -> np.ndarray:
    """Largest difference over the channels [H, W] of two images uint8 [H, W, 3]."""
    return np.abs(one.numpy().astype(int) - other.numpy().astype(int)).max(axis=-1)


def filled(edges: tf.Tensor, size: tuple[int, int]) -> tf.Tensor:
    """Coverage [H, W] by the closed loops whose `edges` are [n, 2 ends, 2]."""
    return rasterizer.integrate_coverage(
        rasterizer.sum_contributions(rasterizer.edge_contributions(edges, size), size), size
    )[0]
