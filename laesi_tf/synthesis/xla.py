"""Compile functions of tensors and scene parameters with XLA."""

import dataclasses
import functools
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast

import tensorflow as tf

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_TENSOR = object()
"""Marks the place of a tensor among static arguments."""


class _PackedParams(NamedTuple):
    """A parameter dataclass as one vector, since every argument of a compiled function costs time."""

    kind: type
    is_bool: tuple[bool, ...]
    numbers: tf.Tensor


def compile_with_xla(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile `function` once for each set of shapes and static arguments that it meets.

    Positional arguments are tensors, nested tuples of them, sampled parameter dataclasses, or hashable static
    values (sizes, names). The same compiled code runs eagerly and inside tf.data.
    """
    # One tf.function for each signature: a single one would warn of retracing, which is intended here.
    compiled: dict[Hashable, Callable[..., Any]] = {}
    plain: Callable[..., Result] = function

    def call(*arguments: Any) -> Any:
        packed = [_pack(argument) for argument in arguments]
        leaves = tf.nest.flatten(packed)
        signature = tuple((leaf.shape, leaf.dtype) if tf.is_tensor(leaf) else leaf for leaf in leaves)
        if signature not in compiled:
            static = [_TENSOR if tf.is_tensor(leaf) else leaf for leaf in leaves]
            structure = tf.nest.pack_sequence_as(packed, static)
            # TensorFlow counts retracing per code object, which a partial does not have.
            trace = functools.partial(_call_with_static, plain, structure)
            compiled[signature] = tf.function(trace, jit_compile=True, autograph=False)
        return compiled[signature](*(leaf for leaf in leaves if tf.is_tensor(leaf)))

    call.__name__, call.__doc__ = function.__name__, function.__doc__
    return cast(Callable[Arguments, Result], call)


def _call_with_static(function: Callable[..., Any], structure: Any, *tensors: tf.Tensor) -> Any:
    """Call `function` with the arguments in `structure`, in which tensors take the places marked for them."""
    remaining = iter(tensors)
    leaves = [next(remaining) if leaf is _TENSOR else leaf for leaf in tf.nest.flatten(structure)]
    arguments = tf.nest.pack_sequence_as(structure, leaves)
    return function(*(_unpack(argument) for argument in arguments))


def _pack(argument: Any) -> Any:
    if not dataclasses.is_dataclass(argument):
        return argument
    values = [getattr(argument, field.name) for field in dataclasses.fields(argument)]
    if not all(tf.is_tensor(value) for value in values):
        return argument
    numbers = tf.stack([tf.cast(value, tf.float32) for value in values])
    return _PackedParams(type(argument), tuple(value.dtype == tf.bool for value in values), numbers)


def _unpack(argument: Any) -> Any:
    if not isinstance(argument, _PackedParams):
        return argument
    values = zip(tf.unstack(argument.numbers), argument.is_bool, strict=True)
    return argument.kind(*(value > 0.5 if is_bool else value for value, is_bool in values))
