"""Scenes without any nuisance, and the same scenes with one.

A scene is sampled as ever, then some of its numbers are replaced: what is not replaced stays as it was, to
the last bit. One traced graph renders all nuisances and severities.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import tensorflow as tf

from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.synthesis import Scene, load_ranges, render_scene, sample_scene
from laesi_tf.synthesis.geometry import ImageSize
from laesi_tf.synthesis.props.registry import PROPS

VIEW_MM = 150.0
LEAF_MM = 70.0
Numbers = Mapping[str, float]
"""Numbers of a scene by part and field, such as `camera.tilt_deg`; 1 and 0 for True and False."""

CALM: Numbers = {
    "camera.closest_mm": VIEW_MM,
    "camera.farthest_mm": VIEW_MM,
    "camera.place_x": 0.5,
    "camera.place_y": 0.5,
    "camera.tilted": 0,
    "camera.tilt_deg": 0,
    "camera.roll": 0.1,
    "camera.distorted": 0,
    "camera.k1": 0,
    "camera.lens_x": 0,
    "camera.lens_y": 0,
    "camera.bent": 0,
    "camera.bend": 0,
    "camera.blurred": 1,
    "camera.blur_mm": 0.05,
    "camera.noise": 0.004,
    "camera.warmth": 0,
    "camera.green": 0,
    "camera.exposure": 0.88,
    "camera.contrast": 1,
    "camera.compressed": 0,
    "camera.sharpened": 0,
    "camera.resized": 0,
    "camera.is_jpeg": 0,
    "paper.kind": 0,
    "paper.dotted": 0,
    "paper.has_5mm": 1,
    "paper.has_10mm": 1,
    "paper.balance": 1,
    "paper.strength_1mm": 0.5,
    "paper.strength_5mm": 0.6,
    "paper.strength_10mm": 0.7,
    "paper.print_wear": 0.1,
    "paper.creased": 0,
    "paper.edged": 0,
    "paper.cut": 0,
    "paper.scrap": 0,
    "paper.left": 60,
    "paper.right": 60,
    "paper.top": 60,
    "paper.bottom": 60,
    "light.strength": 0.3,
    "light.offset_mm": 1,
    "light.softness_mm": 1,
    "light.slope": 0.1,
    "light.cast": 0,
    "light.glass": 0,
    "light.photographer": 0,
    "light.glare": 0,
    "light.glare_strength": 0,
    "light.glare_x": 0.12,
    "light.glare_y": 0.08,
    "light.glare_size": 0.2,
    "leaf.length_mm": LEAF_MM,
    "leaf.aspect": 0.5,
    "leaf.petiole": 0.12,
    "leaf.bitten": 0,
    "leaf.holed": 0,
    "leaf.hole_radius": 0,
    "surface.margin_pale": 0,
    "surface.margin_browned": 0,
    "surface.spotted": 0,
    **{f"{name}.{name}": 0 for name in PROPS},
    **{f"{name}.gap_mm": 4 for name in PROPS},
    "handwriting.stroke_mm": 0.5,
    "scribble.stroke_mm": 0.5,
}
"""A leaf on clean millimetre paper, seen from above in even light."""


class CalmScenes:
    """Renders scene `index` of a seed, calm but for some numbers."""

    def __init__(self, *, seed: int, size: ImageSize) -> None:
        """Take the seed of the leaves and the (height, width) of the pictures."""
        self._seed, self._render = seed, _trace_renderer(size)

    def render(self, index: int, numbers: Numbers) -> StressPhoto:
        """Render a scene in which `numbers` replace those of `CALM`. Raises KeyError for an unknown one."""
        if unknown := set(numbers) - set(CALM):
            raise KeyError(f"no number of a calm scene is called {sorted(unknown)[0]}")
        values = list({**CALM, **numbers}.values())
        sample = self._render(*(tf.constant(number, tf.int64) for number in (self._seed, index)), values)
        return StressPhoto(
            image=sample["image"].numpy(),
            mask=sample["mask"].numpy() > 0,
            area_cm2=float(sample["area_cm2"]),
            px_per_mm=float(sample["px_per_mm"]),
        )


@functools.cache
def _trace_renderer(size: ImageSize) -> Callable[..., dict[str, tf.Tensor]]:
    """Return the graph that renders a scene of (seed, index) with the numbers of CALM, in their order."""
    ranges = load_ranges("phone").without_empty_sheets().with_passes(1)

    def render(seed: tf.Tensor, index: tf.Tensor, values: tf.Tensor) -> dict[str, tf.Tensor]:
        scene = sample_scene(seed, index, ranges)
        scene = replace_numbers(scene, dict(zip(CALM, tf.unstack(values), strict=True)))
        sample = render_scene(scene, size)
        return {name: sample[name] for name in ("image", "mask", "area_cm2", "px_per_mm")}

    number = tf.TensorSpec([], tf.int64)
    signature = (number, number, tf.TensorSpec([len(CALM)], tf.float32))
    return tf.function(render, input_signature=signature, autograph=False)


def replace_numbers(scene: Scene, numbers: Mapping[str, tf.Tensor]) -> Scene:
    """Return `scene` with other numbers, float32 [] each, by part or prop and field."""
    by_part: dict[str, dict[str, tf.Tensor]] = {}
    for name, value in numbers.items():
        part, field = name.split(".")
        by_part.setdefault(part, {})[field] = value
    props = {
        name: prop._replace(params=_replace_fields(prop.params, by_part.get(name, {})))
        for name, prop in scene.props.items()
    }
    parts = {
        name: _replace_fields(getattr(scene, name), fields)
        for name, fields in by_part.items()
        if name not in PROPS
    }
    return dataclasses.replace(scene, props=props, **parts)


def _replace_fields(params: Any, fields: Mapping[str, tf.Tensor]) -> Any:
    changed = {
        name: value > 0.5 if getattr(params, name).dtype == tf.bool else value
        for name, value in fields.items()
    }
    return dataclasses.replace(params, **changed)
