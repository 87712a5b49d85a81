"""Measure the CPU time that each component of a scene takes."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.sample import Sample
from laesi_tf.synthesis import COMPONENTS, Ranges, synthesise


def measure_component_cost(
    ranges: Ranges,
    groups: Mapping[str, Sequence[str]] | None = None,
    *,
    repeats: int,
    seed: int,
    size: tuple[int, int],
    images: int = 48,
) -> dict[str, MedianIqr]:
    """Measure the CPU microseconds per image of each component: all components less all but this one.

    `ranges` has all components in every image; with `groups`, these are measured instead. The time is that
    of all threads of this process, so other processes matter little. Each image is rendered in all ways in
    succession, since the differences are smaller than a processor's drift within a second. One repeat is the
    median of `images`.
    """
    groups = groups or {name: (name,) for name in COMPONENTS if ranges.has(name)}
    reduced = [dataclasses.replace(ranges, without=ranges.without | set(group)) for group in groups.values()]
    renderers = [
        trace_renderer(variant, seed=seed, size=size)
        for variant in progress_bar([ranges, *reduced], desc="tracing", unit="component")
    ]
    medians = []
    for repeat in progress_bar(range(repeats), desc="components", unit="repeat"):
        indices = range(repeat * images, (repeat + 1) * images)
        times = np.array([_measure_cpu_us(renderers, index) for index in indices])
        medians.append(np.median(times[:, :1] - times[:, 1:], axis=0))
    return {name: MedianIqr.of(costs) for name, costs in zip(groups, np.transpose(medians), strict=True)}


def trace_renderer(ranges: Ranges, *, seed: int, size: tuple[int, int]) -> Callable[[tf.Tensor], Sample]:
    """Trace and optimise a graph from an index to its sample."""
    traced = tf.function(lambda index: synthesise(seed, size=size, ranges=ranges, index=index))
    renderer = traced.get_concrete_function(tf.TensorSpec([], tf.int64))
    renderer(tf.constant(0, tf.int64))  # the first call optimises the graph
    return renderer


def _measure_cpu_us(renderers: Sequence[Callable[[tf.Tensor], Any]], index: int) -> list[float]:
    """Measure the CPU time of image `index` with each renderer, in an order that rotates with the index."""
    argument = tf.constant(index, tf.int64)
    times = [0.0] * len(renderers)
    for offset in range(len(renderers)):
        number = (offset + index) % len(renderers)
        started = time.process_time()
        renderers[number](argument)
        times[number] = (time.process_time() - started) * 1e6
    return times
