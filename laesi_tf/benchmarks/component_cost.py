"""Measure the CPU time that each component of a scene takes."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

from laesi_tf.common.progress import progress_bar
from laesi_tf.synthesis import COMPONENTS, Ranges

# isort: split
import numpy as np
import tensorflow as tf

from laesi_tf.benchmarks.timing import MedianIqr, Size
from laesi_tf.synthesis import synthesise


def measure_component_cost(
    every: Ranges, *, repeats: int, seed: int, size: Size, images: int = 48
) -> dict[str, MedianIqr]:
    """CPU microseconds per picture that each component takes: all components less all but this one.

    `every` has all components in every picture. The time is that of all threads of this process, so what
    else the machine does counts little. Each picture is made in all ways one after the other, since the
    differences are smaller than a processor's drift over a second; a turn's figure is the median of `images`.
    """
    names = [name for name in COMPONENTS if every.has(name)]
    kinds = [every, *(dataclasses.replace(every, without=every.without | {name}) for name in names)]
    makers = [
        trace_renderer(ranges, seed, size) for ranges in progress_bar(kinds, desc="tracing", unit="component")
    ]
    medians = []
    for turn in progress_bar(range(repeats), desc="components", unit="turn"):
        spent = np.array(
            [_measure_cpu_us(makers, index) for index in range(turn * images, (turn + 1) * images)]
        )
        medians.append(np.median(spent[:, :1] - spent[:, 1:], axis=0))
    return {name: MedianIqr.of(costs) for name, costs in zip(names, np.transpose(medians), strict=True)}


def trace_renderer(ranges: Ranges, seed: int, size: Size) -> Callable[[tf.Tensor], dict[str, tf.Tensor]]:
    """A graph from an index to its picture, ready to be timed."""
    traced = tf.function(lambda index: synthesise(seed, size=size, ranges=ranges, index=index))
    made = traced.get_concrete_function(tf.TensorSpec([], tf.int64))
    made(tf.constant(0, tf.int64))  # the first call optimises the graph
    return made


def _measure_cpu_us(makers: Sequence[Callable[[tf.Tensor], Any]], index: int) -> list[float]:
    """CPU time of picture `index` with each of `makers`, in an order that moves on with the index."""
    picture = tf.constant(index, tf.int64)
    spent = [0.0] * len(makers)
    for place in range(len(makers)):
        chosen = (place + index) % len(makers)
        begun = time.process_time()
        makers[chosen](picture)
        spent[chosen] = (time.process_time() - begun) * 1e6
    return spent
