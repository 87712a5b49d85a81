"""Pieces of a scene compiled (XLA): many small sums on its numbers, or chains of passes over its pixels.

Op by op, every sum and product of a picture is a pass over memory, some sixty of them, and what runs the ops
costs as much again; compiled together they take a third of the time. Each call costs some fifty microseconds,
so the pieces are few and large. What does not belong in them, as XLA makes it ten to a thousand times slower:
adding into cells one by one, searching a sorted list, cutting a window out of a constant, and finding the
places that are looked up in a table in the same piece as looking them up.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import tensorflow as tf

Result = TypeVar("Result")


class _PackedParams(NamedTuple):
    """A room of the scene as one vector, since every argument of a compiled function costs time."""

    kind: type
    is_bool: tuple[bool, ...]
    numbers: tf.Tensor


def compile_with_xla(function: Callable[..., Result]) -> Callable[..., Result]:
    """Compile `function` of tensors, rooms of a scene and sizes once for each shape that it meets.

    The same compiled code runs eagerly and inside tf.data.
    """

    @functools.partial(tf.function, jit_compile=True, autograph=False)
    @functools.wraps(function)
    def compiled(*packed: Any) -> Result:
        return function(*(_unpack(argument) for argument in packed))

    @functools.wraps(function)
    def call(*arguments: Any) -> Result:
        return compiled(*(_pack(argument) for argument in arguments))

    return call


def _pack(argument: Any) -> Any:
    if not dataclasses.is_dataclass(argument):
        return argument
    values = [getattr(argument, field.name) for field in dataclasses.fields(argument)]
    numbers = tf.stack([tf.cast(value, tf.float32) for value in values])
    return _PackedParams(type(argument), tuple(value.dtype == tf.bool for value in values), numbers)


def _unpack(argument: Any) -> Any:
    if not isinstance(argument, _PackedParams):
        return argument
    values = zip(tf.unstack(argument.numbers), argument.is_bool, strict=True)
    return argument.kind(*(value > 0.5 if is_bool else value for value, is_bool in values))
