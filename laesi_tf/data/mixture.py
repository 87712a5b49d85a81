"""One stream of pictures from several sources: live scenes, cached records, real photos.

A TOML file has a table for each; a `weight` is a source's share of the stream, a `count` also bounds how many
different pictures it gives (the paper's "1,7K real + 5K synthetic"):

    [scenes]
    kind = "live"               # scenes made on the fly
    count = 5000
    ranges = "rendering_2"      # or a table of ranges, [scenes.ranges]; those of the run if left out

    [cached]
    kind = "records"            # a data set that generate made
    folder = "dataset"
    count = 2000

    [photographs]
    kind = "photos"             # real photos
    manifest = "photos/manifest.csv"
    split = "train"
    count = 1700
    stream = true               # decode them anew each time instead of holding them in memory

Weights and counts do not mix; weights are normalised; a source of weight 0 is not even opened. What is drawn
at a place of the stream depends on nothing but the place, so a run that was killed continues where it was.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf

from laesi_tf.common.errors import InputError
from laesi_tf.data.mixture_sources import SOURCE_OPENERS, SampleStream, SourceContext

SLOTS = 256
"""Pictures in which each source has its exact share; shares are rounded to as many parts."""
_SHARE: dict[str, Any] = {"kind": str, "weight": int | float, "count": int}
_KEYS: dict[str, dict[str, Any]] = {
    "live": _SHARE | {"ranges": str | dict},
    "records": _SHARE | {"folder": str},
    "photos": _SHARE | {"manifest": str, "split": str, "stream": bool},
}
# What every source gives; a model is fed no more.
_FIELDS = ("image", "mask", "area_cm2", "px_per_mm")


@dataclass(frozen=True)
class Source:
    """Where pictures come from, dicts of image, mask, area_cm2 and px_per_mm, and their share."""

    name: str
    weight: float
    stream: SampleStream


def load_mixture(
    path: Path | str,
    *,
    size: tuple[int, int],
    seed: int,
    masked: bool,
    ranges: str = "rendering_2",
    textures: tf.Tensor | None = None,
) -> list[Source]:
    """The sources that a TOML file names, giving pictures of `size`; paths are relative to it.

    With `masked`, photos without a mask are left out. Live scenes have the run's `ranges` unless the file
    says otherwise, its `textures` (see `laesi_tf.synthesis.synthesise`), and one light for each leaf. Raises
    InputError for unknown keys, for weights beside counts, and for a source that lists fewer pictures than
    are asked of it.
    """
    path = Path(path)
    tables = _read_tables(path)
    wanted = {name: table for name, table in tables.items() if _share(table) > 0}
    if not wanted:
        raise InputError(f"mixture {path} gives no source a weight or count above 0")
    sources, lives = [], 0
    for name, table in wanted.items():
        # Another live source has a seed of its own: with the same one it would show the same leaves.
        opened = SourceContext(path.parent, size, seed + lives, masked, ranges, textures)
        sources.append(Source(name, _share(table), SOURCE_OPENERS[table["kind"]](table, opened)))
        lives += table["kind"] == "live"
    return sources


def mix_sources(sources: Sequence[Source], *, seed: int, start: int = 0) -> tf.data.Dataset:
    """The stream of pictures from place `start` on, without end: each source has its share of every SLOTS."""
    quotas = _slots_per_source([source.weight for source in sources])
    slots = tf.constant(np.repeat(np.arange(len(sources)), quotas))

    def block(number: tf.Tensor) -> tf.Tensor:
        return tf.gather(slots, tf.argsort(tf.random.stateless_uniform([SLOTS], [seed, number])))

    first, passed = divmod(start, SLOTS)
    earlier = block(tf.constant(first, tf.int64)).numpy()[:passed]
    drawn = first * quotas + np.bincount(earlier, minlength=len(sources))
    choices = tf.data.Dataset.range(first, 2**62).map(block).unbatch().skip(passed)
    streams = [source.stream(int(before)) for source, before in zip(sources, drawn, strict=True)]
    return tf.data.Dataset.choose_from_datasets(
        [stream.map(_keep_common_fields) for stream in streams], choices
    )


def _keep_common_fields(picture: dict[str, tf.Tensor]) -> dict[str, tf.Tensor]:
    return {name: picture[name] for name in _FIELDS}


def _slots_per_source(weights: Sequence[float]) -> np.ndarray:
    """How many of SLOTS places each source gets: by largest remainder, and at least one."""
    exact = np.array(weights) / sum(weights) * (SLOTS - len(weights))
    quotas = np.floor(exact).astype(int)
    quotas[np.argsort(quotas - exact)[: SLOTS - len(weights) - quotas.sum()]] += 1
    return quotas + 1


def _read_tables(path: Path) -> dict[str, dict[str, Any]]:
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"cannot read mixture {path}: {error}") from error
    for name, table in tables.items():
        kind = table.get("kind") if isinstance(table, dict) else None
        if kind not in _KEYS:
            raise InputError(f"mixture {path}: [{name}] is of kind {kind!r}; use {', '.join(_KEYS)}")
        for key, value in table.items():
            _check_value(key, value, _KEYS[kind], f"mixture {path}: [{name}]")
        if not table.keys() & {"weight", "count"}:
            raise InputError(f"mixture {path}: [{name}] has no weight and no count; 0 leaves it out")
    if len({share for table in tables.values() for share in ("weight", "count") if share in table}) > 1:
        raise InputError(f"mixture {path} has weights and counts; give every source one or the other")
    return tables


def _check_value(key: str, value: Any, known: Mapping[str, Any], where: str) -> None:
    if key not in known:
        raise InputError(f"{where} has no {key!r}; use {', '.join(sorted(known))}")
    if not isinstance(value, known[key]) or isinstance(value, bool) is not (known[key] is bool):
        raise InputError(f"{where} {key} = {value!r} is of the wrong type")
    if key in ("weight", "count") and value < 0:
        raise InputError(f"{where} {key} = {value!r} must not be below 0")


def _share(table: Mapping[str, Any]) -> float:
    return float(table.get("weight", table.get("count", 0)))
