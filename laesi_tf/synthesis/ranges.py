"""Numbers and the ranges they are drawn from: one tree of dataclasses read in two ways.

Each room of the scene (paper, leaf, light, ...) declares its numbers once, as a frozen dataclass whose
defaults are the ranges of preset `rendering_2`. Drawing from such a tree gives the same tree with a scalar
tensor in place of each range. A range is one of

- `(low, high)`: uniform between the two;
- `Chance(p)`: True with probability p;
- a plain number: always that number.
"""

import dataclasses
from typing import Any, NamedTuple, TypeVar

import numpy as np
import tensorflow as tf

# A range in Ranges, a scalar tensor in a Scene: no static type says both.
Number = Any
Params = TypeVar("Params")


class Probability(NamedTuple):
    """True with probability `p`."""

    p: float


def fields_of(room: Any) -> dict[str, Any]:
    """The fields of `room` as a dict, in order of declaration."""
    return {field.name: getattr(room, field.name) for field in dataclasses.fields(room)}


def late(default: Any) -> Any:
    """A field, behind all others, that a room gained when pictures had been made of it.

    A number of its own would move those of every field that is drawn after it, and so change every picture.
    It is drawn with the low bits of another field's number instead: the first late one with the first's.
    """
    return dataclasses.field(default=default, metadata={"late": True})


def field_count(room: Any) -> int:
    """How many uniform numbers `draw` and `draw_one_of` take for `room`: one for each field but late ones."""
    return len(dataclasses.fields(room)) - _lates(room)


def _lates(room: Any) -> int:
    return sum(field.metadata.get("late", False) for field in dataclasses.fields(room))


def sample_params(room: Params, uniform: tf.Tensor) -> Params:
    """Draw each number of `room` from its range with `uniform` [count(room)] in [0, 1)."""
    return sample_params_of_kind([room], tf.constant(0), uniform)


def sample_params_of_kind(rooms: list[Params], which: tf.Tensor, uniform: tf.Tensor) -> Params:
    """Draw the numbers of `rooms[which]`: float32 scalars, or bool scalars where the range is a Chance."""
    bounds = np.array(
        [[_interval(value) for value in fields_of(room).values()] for room in rooms], np.float32
    )
    low, high = tf.unstack(tf.gather(tf.constant(bounds), which), axis=-1)
    if lates := _lates(rooms[0]):
        uniform = tf.concat([uniform, _low_bits(uniform[:lates])], axis=0)
    values = tf.unstack(low + uniform * (high - low))
    drawn = {
        name: value >= 0 if isinstance(spec, Probability) else value
        for (name, spec), value in zip(fields_of(rooms[0]).items(), values, strict=True)
    }
    return dataclasses.replace(rooms[0], **drawn)  # type: ignore[type-var]


def _low_bits(uniform: tf.Tensor) -> tf.Tensor:
    """Numbers in [0, 1) from the last 12 of the 23 bits that make `uniform`.

    They say nothing of the bits before them, which decide what the numbers themselves are used for.
    """
    return tf.math.floormod(uniform * 2**11, 1.0)


def _interval(spec: Any) -> tuple[float, float]:
    """(low, high) of a range; a Chance p becomes an interval not below zero with probability p."""
    if isinstance(spec, Probability):
        return spec.p - 1, spec.p
    if isinstance(spec, tuple):
        return spec
    return spec, spec
