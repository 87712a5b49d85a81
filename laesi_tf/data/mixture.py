"""Mix samples from several sources into one stream: live scenes, a generated data set, photos.

A TOML file has a table for each source; a `weight` is its share of the stream, a `count` also limits how many
different samples it gives (the paper's "1,7K real + 5K synthetic"):

    [scenes]
    kind = "live"               # scenes rendered during training
    count = 5000
    ranges = "rendering_2"      # or a table of ranges, [scenes.ranges]; default: those of the run

    [cached]
    kind = "records"            # a data set that generate wrote
    folder = "dataset"
    count = 2000

    [photographs]
    kind = "photos"             # real photos
    manifest = "photos/manifest.csv"
    split = "train"
    count = 1700
    stream = true               # decode photos each time instead of keeping them in memory

A file has either weights or counts; weights are normalised; a source of weight 0 is not even opened. A sample
of the stream depends on nothing but its position, so a run that was stopped continues with the same samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import check_choice, from_table, read_toml
from laesi_tf.data.mixture_sources import (
    SOURCE_TYPES,
    LiveSource,
    SampleStream,
    SourceContext,
    SourceOptions,
)
from laesi_tf.data.sample import COMMON_KEYS

SLOTS = 256
"""Successive samples in which each source has its exact share; shares are rounded to 1/256."""


@dataclass(frozen=True)
class Source:
    """A stream of samples and its share of the mixture."""

    name: str
    weight: float
    stream: SampleStream


def load_mixture(
    path: Path | str,
    *,
    size: tuple[int, int],
    seed: int,
    needs_masks: bool,
    needs_leaf: bool = False,
    ranges: str = "rendering_2",
    textures: tf.Tensor | None = None,
) -> list[Source]:
    """Open the sources of a TOML file, whose samples have `size` (h, w); paths are relative to the file.

    With `needs_masks`, photos without a mask are skipped; with `needs_leaf`, no scene is an empty sheet. Live
    scenes use the run's `ranges`, unless the file gives others, its `textures` (see
    `laesi_tf.synthesis.synthesise`), and one lighting pass. Raises InputError for unknown keys, for weights
    beside counts, and for a source that has fewer samples than its count.
    """
    path = Path(path)
    tables = {name: table for name, table in _read_sources(path).items() if table.share > 0}
    if not tables:
        raise InputError(f"mixture {path} gives no source a weight or count above 0")
    sources, live_sources = [], 0
    for name, table in tables.items():
        # Each live source needs its own seed: with the same one it would show the same leaves.
        context = SourceContext(
            path.parent, size, seed + live_sources, needs_masks, needs_leaf, ranges, textures
        )
        sources.append(Source(name, table.share, table.open(context)))
        live_sources += isinstance(table, LiveSource)
    return sources


def mix_sources(sources: Sequence[Source], *, seed: int, start: int = 0) -> tf.data.Dataset:
    """Mix samples from position `start` on, without end: each source has its share of every SLOTS."""
    quotas = _slots_per_source([source.weight for source in sources])
    slots = tf.constant(np.repeat(np.arange(len(sources)), quotas))

    def shuffle_block(block: tf.Tensor) -> tf.Tensor:
        return tf.gather(slots, tf.argsort(tf.random.stateless_uniform([SLOTS], [seed, block])))

    first_block, skipped = divmod(start, SLOTS)
    choices_before = shuffle_block(tf.constant(first_block, tf.int64)).numpy()[:skipped]
    used = first_block * quotas + np.bincount(choices_before, minlength=len(sources))
    choices = tf.data.Dataset.range(first_block, 2**62).map(shuffle_block).unbatch().skip(skipped)
    streams = [source.stream(int(before)) for source, before in zip(sources, used, strict=True)]
    return tf.data.Dataset.choose_from_datasets(
        [stream.map(lambda sample: {key: sample[key] for key in COMMON_KEYS}) for stream in streams], choices
    )


def _slots_per_source(weights: Sequence[float]) -> NDArray[np.int64]:
    """Divide SLOTS among the sources by largest remainder; each gets at least one."""
    exact = np.array(weights) / sum(weights) * (SLOTS - len(weights))
    quotas = np.floor(exact).astype(int)
    quotas[np.argsort(quotas - exact)[: SLOTS - len(weights) - quotas.sum()]] += 1
    return quotas + 1


def _read_sources(path: Path) -> dict[str, SourceOptions]:
    sources: dict[str, SourceOptions] = {}
    for name, table in read_toml(path, what="mixture").items():
        where = f"mixture {path}: [{name}]"
        if not isinstance(table, dict):
            raise InputError(f"mixture {path}: {name} must be a table, [{name}]")
        kind = table.get("kind")
        try:
            check_choice("kind", kind, SOURCE_TYPES)
        except InputError as error:
            raise InputError(f"{where} {error}") from None
        sources[name] = from_table(SOURCE_TYPES[str(kind)], table, where=where)
        if sources[name].weight is None and sources[name].count is None:
            raise InputError(f"{where} has no weight and no count; 0 leaves it out")
    has_weights = any(source.weight is not None for source in sources.values())
    if has_weights and any(source.count is not None for source in sources.values()):
        raise InputError(f"mixture {path} has weights and counts; give every source one or the other")
    return sources
