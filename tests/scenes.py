"""Scenes with given parameters, and comparisons of images. For tests of synthesis only."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.synthesis import COMPONENTS, Ranges, Scene, load_ranges, rasterizer
from laesi_tf.synthesis.presets import enable_all_components
from laesi_tf.synthesis.props.registry import PROPS, prop_ranges
from laesi_tf.synthesis.ranges import Choice, Probability, fields_of
from laesi_tf.synthesis.scene import PARTS

RENDERING_2 = load_ranges("rendering_2")


def middle(ranges: Any, **given: float | bool) -> Any:
    """Return parameters at the middle of their `ranges`, each Probability False, except those `given`.

    A Choice is its most frequent name.
    """
    return dataclasses.replace(
        ranges,
        **{name: tf.constant(given.get(name, _middle(spec))) for name, spec in fields_of(ranges).items()},
    )


def _middle(spec: Any) -> float | bool:
    if isinstance(spec, Choice):
        return float(np.argmax(spec.weights))
    return False if isinstance(spec, Probability) else float(np.mean(spec))


def bounds(spec: Any) -> tuple[float, float]:
    """Return the lowest and highest number of a range; 0 and 1 stand for False and True."""
    if isinstance(spec, Probability):
        return 0.0, 1.0
    if isinstance(spec, Choice):
        return 0.0, len(spec.names) - 1.0
    return spec if isinstance(spec, tuple) else (spec, spec)


def changed(ranges: Ranges, part: str, **fields: Any) -> Ranges:
    """Return `ranges` with other `fields` in one part."""
    return dataclasses.replace(ranges, **{part: dataclasses.replace(getattr(ranges, part), **fields)})


def only(*components: str, ranges: Ranges = RENDERING_2) -> Ranges:
    """Return `ranges` with these components only."""
    return dataclasses.replace(ranges, without=frozenset(COMPONENTS) - frozenset(components))


def complete(ranges: Ranges = RENDERING_2) -> Ranges:
    """Return `ranges` with every component in every image, the red square too, and one lighting pass."""
    return enable_all_components(changed(ranges.with_passes(1), "props", calibration=Probability(0.5)))


def specs(ranges: Ranges) -> Iterator[tuple[str, str, Any]]:
    """Yield (part, field, range) of all that scenes are sampled from; kinds of leaves as `leaf.oak`."""
    parts = {part: getattr(ranges, part) for part in PARTS}
    kinds = {f"leaf.{name}": kind for name, (_, kind) in ranges.leaf.items()}
    for part, params in (parts | kinds).items():
        for field, spec in fields_of(params).items():
            yield part, field, spec


def parts_of(scene: Scene) -> dict[str, Any]:
    """Return the parameters of each part of a scene; props as `props.pen`."""
    parts = {part: getattr(scene, part) for part in (*PARTS, "leaf") if part != "props"}
    return parts | {f"props.{name}": prop.params for name, prop in scene.props.items()}


def with_parts(scene: Scene, parts: dict[str, Any]) -> Scene:
    """Return `scene` with other parameters, named as in `parts_of`."""
    props = {name: prop._replace(params=parts[f"props.{name}"]) for name, prop in scene.props.items()}
    others = {part: params for part, params in parts.items() if "." not in part}
    return dataclasses.replace(scene, props=props, **others)


def ranges_of_parts(ranges: Ranges) -> dict[str, Any]:
    """Return the ranges of each part, named as in `parts_of`; those of the first kind of leaf."""
    parts = {part: getattr(ranges, part) for part in PARTS if part != "props"}
    props = {name: prop_ranges(name, ranges.props) for name in PROPS if ranges.has(name)}
    return parts | {"leaf": next(iter(ranges.leaf.values()))[1]} | {f"props.{n}": r for n, r in props.items()}


def difference(one: tf.Tensor, other: tf.Tensor) -> np.ndarray:
    """Return the largest difference over the channels, [H, W], of two images uint8 [H, W, 3]."""
    return np.abs(one.numpy().astype(int) - other.numpy().astype(int)).max(axis=-1)


def filled(edges: tf.Tensor, size: tuple[int, int]) -> tf.Tensor:
    """Return the coverage [H, W] by the closed loops of `edges` [n, 2 ends, 2]."""
    return rasterizer.integrate_coverage(
        rasterizer.sum_contributions(rasterizer.edge_contributions(edges, size), size), size
    )[0]
