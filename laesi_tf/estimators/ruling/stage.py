"""Stages of a reading as TensorFlow functions of their own.

Each is traced once, however often it is called: traced as one graph, the reading has 28,000 operations and
takes half a minute before the first photo. Called in sequence, a stage that a photo does not need costs
nothing; within another graph, as for export, the stages are called like any operation.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, partial, wraps
from threading import Lock
from typing import Any, TypeVar, cast

import tensorflow as tf

Function = TypeVar("Function", bound=Callable[..., Any])

_KEPT = 4
"""Values of a stage's parameters whose graphs are kept, so that benchmarks of many do not fill the memory."""


_ARE_INLINED: ContextVar[bool] = ContextVar("stages_are_inlined", default=False)


@contextmanager
def inline_stages() -> Iterator[None]:
    """Make stages part of the graph that is traced inside this context: LiteRT knows no function calls."""
    token = _ARE_INLINED.set(True)
    try:
        yield
    finally:
        _ARE_INLINED.reset(token)


def compile_stage(function: Function) -> Function:
    """Return `function`, compiled when it is called first.

    Its positional arguments are tensors and tuples of tensors. Its keywords are parameters, frozen
    dataclasses; each of their values is traced by itself.
    """

    # Threads that measure photos must not trace a stage twice.
    lock = Lock()

    # By value, as tf.function would forget a trace with the object that it was made for.
    @lru_cache(_KEPT)
    def compile_for(**params: Any) -> Callable[..., Any]:
        stage = partial(function, **params)
        # Graphs and profiles show it.
        stage.__name__ = function.__name__  # type: ignore[attr-defined]
        return tf.function(stage, autograph=False, experimental_attributes={"_noinline": True})

    @wraps(function)
    def call(*tensors: Any, **params: Any) -> Any:
        if _ARE_INLINED.get():
            return function(*tensors, **params)
        with lock:
            compiled = compile_for(**params)
        return compiled(*tensors)

    return cast(Function, call)
