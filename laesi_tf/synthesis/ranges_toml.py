"""Ranges as TOML files that users edit.

A file names the preset that it starts from and what it changes; everything else stays as it was:

    base = "rendering_2"
    lighting_passes = 1
    without = ["glass"]

    [paper]
    hue = [0.0, 0.1]            # uniform between the two
    tinted = {chance = 0.5}     # true half of the time
    kind = {millimetre = 0.8, plain = 0.2}      # relative frequencies

    [leaf.oak]
    weight = 0.6                # relative frequency of this kind of leaf
    length_mm = [60, 120]
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeGuard

from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import check_choice, check_integer, check_key, check_number, read_toml
from laesi_tf.synthesis.leaf.veins import MAX_SECONDARY_VEINS
from laesi_tf.synthesis.presets import PRESETS, RENDERING_2
from laesi_tf.synthesis.ranges import Choice, Probability, fields_of
from laesi_tf.synthesis.scene import COMPONENTS, PARTS, Ranges


def ranges_to_toml(ranges: Ranges) -> str:
    """Return all of `ranges` as TOML text to edit; `load_ranges` reads it back as the same ranges."""
    return "\n".join(_toml_lines(ranges)) + "\n"


def _toml_lines(ranges: Ranges) -> Iterator[str]:
    yield "# [low, high] is uniform between the two, {chance = p} true with probability p,"
    yield "# a single number always that number, {name = weight, ...} one of the names."
    yield "# Omitted keys are as in `base`."
    # The base has all kinds of leaf that the ranges have.
    base = "rendering_2" if set(ranges.leaf) <= set(RENDERING_2.leaf) else "phone"
    yield f'base = "{base}"'
    yield f"lighting_passes = {ranges.lighting_passes}"
    left_out = [f'"{name}"' for name in COMPONENTS if name in ranges.without]
    yield f"without = [{', '.join(left_out)}]"
    for name in PARTS:
        yield from _toml_table(name, fields_of(getattr(ranges, name)))
    for kind, (weight, leaf) in ranges.leaf.items():
        yield from _toml_table(f"leaf.{kind}", {"weight": weight, **fields_of(leaf)})
    for kind in (kind for kind in PRESETS[base].leaf if kind not in ranges.leaf):
        yield from _toml_table(f"leaf.{kind}", {"weight": 0.0})


def _toml_table(name: str, values: dict[str, Any]) -> Iterator[str]:
    yield f"\n[{name}]"
    for key, value in values.items():
        yield f"{key} = {_toml_value(value)}"


def _toml_value(value: Any) -> str:
    if isinstance(value, Probability):
        return f"{{chance = {value.p!r}}}"
    if isinstance(value, Choice):
        weights = zip(value.names, value.weights, strict=True)
        return "{" + ", ".join(f"{name} = {weight!r}" for name, weight in weights if weight) + "}"
    return f"[{value[0]!r}, {value[1]!r}]" if isinstance(value, tuple) else repr(value)


_RENDERABLE = {"closest_mm": (30.0, math.inf), "veins": (0.0, float(MAX_SECONDARY_VEINS))}
"""What the renderer can draw: its polygons have a fixed number of edges, its leaves of veins."""


def load_ranges(source: str | Path | Ranges | Mapping[str, Any]) -> Ranges:
    """Return ranges by preset name, from a TOML file or from its content as a mapping; Ranges pass through.

    Raises InputError that names the file and the key.
    """
    if isinstance(source, Ranges):
        return source
    if isinstance(source, Mapping):
        return _apply_table(dict(source), Path("ranges"))
    if str(source) in PRESETS:
        return PRESETS[str(source)]
    path = Path(source)
    if path.suffix != ".toml":
        raise InputError(f"unknown ranges {str(source)!r}; use {' or '.join(PRESETS)}, or a .toml file")
    return _apply_table(read_toml(path, what="ranges"), path)


def _apply_table(table: dict[str, Any], path: Path) -> Ranges:
    start = PRESETS[check_choice(f"{path}: base", table.pop("base", "rendering_2"), PRESETS)]
    changes: dict[str, Any] = {}
    for key, value in table.items():
        check_key(key, (*PARTS, "leaf", "lighting_passes", "without"), where=f"{path}:")
        if key == "leaf":
            changes[key] = _parse_kinds(start.leaf, _require_table(value, f"{path}: [leaf]"), path)
        elif key in PARTS:
            changes[key] = _parse_params(
                getattr(start, key), _require_table(value, f"{path}: [{key}]"), f"{path}: [{key}]"
            )
        else:
            changes[key] = _parse_setting(key, value, path)
    return dataclasses.replace(start, **changes)


def _parse_setting(key: str, value: Any, path: Path) -> Any:
    if key == "lighting_passes":
        return check_integer(f"{path}: lighting_passes", value, low=1)
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError(f"{path}: without = {value!r} must be a list of components")
    for name in value:
        check_key(name, COMPONENTS, where=f"{path}: without:")
    return frozenset(value)


def _parse_kinds(start: Mapping[str, Any], table: dict[str, Any], path: Path) -> dict[str, Any]:
    kinds = dict(start)
    for name, changes in table.items():
        check_key(name, kinds, where=f"{path}: [leaf]")
        weight, kind = kinds[name]
        changes = dict(_require_table(changes, f"{path}: [leaf.{name}]"))
        weight = check_number(f"{path}: [leaf.{name}] weight", changes.pop("weight", weight), low=0)
        kinds[name] = (weight, _parse_params(kind, changes, f"{path}: [leaf.{name}]"))
    if not sum(weight for weight, _ in kinds.values()):
        raise InputError(f"{path}: [leaf] every weight is 0; give at least one kind of leaf a weight")
    return {name: kind for name, kind in kinds.items() if kind[0] > 0}


def _parse_params(start: Any, table: dict[str, Any], where: str) -> Any:
    known = fields_of(start)
    changes = {}
    for key, value in table.items():
        check_key(key, known, where=where)
        changes[key] = _parse_range(value, known[key], f"{where} {key}")
        if key in _RENDERABLE:
            _require_within(_RENDERABLE[key], changes[key], f"{where} {key}")
    return dataclasses.replace(start, **changes)


def _parse_range(value: Any, start: Any, where: str) -> Any:
    """Parse one range: a probability or choice where `start` is one, otherwise a number or an interval."""
    if isinstance(start, Choice):
        return _parse_choice(value, start, where)
    if isinstance(start, Probability):
        chance = value.get("chance") if isinstance(value, dict) else None
        if not _is_number(chance) or not 0 <= chance <= 1:
            raise InputError(f"{where} = {value!r} must be {{chance = p}} with p from 0 to 1")
        return Probability(float(chance))
    if _is_number(value):
        return float(value)
    pair = value if isinstance(value, list) else []
    if len(pair) != 2 or not all(map(_is_number, pair)) or pair[0] > pair[1]:
        raise InputError(f"{where} = {value!r} must be a number or [low, high]")
    return float(pair[0]), float(pair[1])


def _parse_choice(value: Any, start: Choice, where: str) -> Choice:
    table = _require_table(value, where)
    for name in table:
        check_key(name, start.names, where=f"{where}:")
    weights = {name: check_number(f"{where}: {name}", weight, low=0) for name, weight in table.items()}
    if not sum(weights.values()):
        raise InputError(f"{where} = {value!r} gives every name weight 0; give one a weight")
    return start.with_weights(**weights)


def _require_within(limits: tuple[float, float], drawn: Any, where: str) -> None:
    low, high = drawn if isinstance(drawn, tuple) else (drawn, drawn)
    if not limits[0] <= low <= high <= limits[1]:
        raise InputError(f"{where} = {drawn} cannot be drawn; stay within {limits[0]:g} to {limits[1]:g}")


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _require_table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where} must be a table of ranges, not {value!r}")
    return value
