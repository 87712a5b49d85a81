"""Ranges made from others: as the TOML that `load_ranges` reads back, and with nothing left to chance."""

import dataclasses
from collections.abc import Iterator
from typing import Any, TypeVar

from laesi_tf.synthesis.presets import RENDERING_2
from laesi_tf.synthesis.ranges import Chance, numbers
from laesi_tf.synthesis.scene import COMPONENTS, Ranges

Room = TypeVar("Room")

_ROOMS = ("paper", "surface", "light", "props", "camera", "desk")


def every_component(ranges: Ranges) -> Ranges:
    """`ranges` with every Chance above 0 at 1, so that each picture has all that pictures can have."""
    return dataclasses.replace(
        ranges,
        leaf={name: (weight, _certain(kind)) for name, (weight, kind) in ranges.leaf.items()},
        **{name: _certain(getattr(ranges, name)) for name in _ROOMS},
    )


def _certain(room: Room) -> Room:
    chances = [name for name, spec in numbers(room).items() if isinstance(spec, Chance) and spec.p > 0]
    return dataclasses.replace(room, **dict.fromkeys(chances, Chance(1.0)))  # type: ignore[type-var]


def as_toml(ranges: Ranges) -> str:
    """All of `ranges` as TOML text to edit; `load_ranges` reads it back as the same ranges."""
    return "\n".join(_lines(ranges)) + "\n"


def _lines(ranges: Ranges) -> Iterator[str]:
    yield "# [low, high] is uniform between the two, {chance = p} true with probability p,"
    yield "# a single number always that number. What is left out is as in `base`."
    yield 'base = "rendering_2"'
    yield f"lighting_passes = {ranges.lighting_passes}"
    left_out = [f'"{name}"' for name in COMPONENTS if name in ranges.without]
    yield f"without = [{', '.join(left_out)}]"
    for name in _ROOMS:
        yield from _table(name, numbers(getattr(ranges, name)))
    for kind, (weight, leaf) in ranges.leaf.items():
        yield from _table(f"leaf.{kind}", {"weight": weight, **numbers(leaf)})
    for kind in (kind for kind in RENDERING_2.leaf if kind not in ranges.leaf):
        yield from _table(f"leaf.{kind}", {"weight": 0.0})


def _table(name: str, values: dict[str, Any]) -> Iterator[str]:
    yield f"\n[{name}]"
    for key, value in values.items():
        yield f"{key} = {_written(value)}"


def _written(value: Any) -> str:
    if isinstance(value, Chance):
        return f"{{chance = {value.p!r}}}"
    return f"[{value[0]!r}, {value[1]!r}]" if isinstance(value, tuple) else repr(value)
