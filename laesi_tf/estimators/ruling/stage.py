"""Stages of a reading as TensorFlow functions of their own.

Each is traced once, however often it is called: traced as one graph, the reading has 28,000 operations and
takes half a minute before the first photo. Called in sequence, a stage that a photo does not need costs
nothing; within another graph, as for export, the stages are called like any operation.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import tensorflow as tf

Function = TypeVar("Function", bound=Callable[..., Any])


def compile_stage(function: Function) -> Function:
    """Return `function` of tensors and tuples of tensors, compiled when it is called first."""
    compiled = tf.function(function, autograph=False, experimental_attributes={"_noinline": True})
    return cast(Function, compiled)
