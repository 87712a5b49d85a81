"""Check values that people write, in TOML files and flags, against frozen dataclasses.

A dataclass declares each of its fields with `option`: default, help text, and the allowed words or limits.
That one declaration checks values (`check_fields`), reads a table (`from_table`) and makes the flags of a
command (`add_option_arguments`). An error is one sentence in the words of the file:
`c.toml: steps = 0 must be a whole number between 1 and 1000`.

pydantic and cattrs were considered: their errors name Python types and need a table of translations, and
intervals such as `[low, high]` need types of our own with either.
"""

import argparse
import dataclasses
import difflib
import math
import tomllib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, TypeVar

from laesi_tf.common.errors import InputError

T = TypeVar("T")


def option(
    default: Any = dataclasses.MISSING,
    help: str = "",
    *,
    choices: Collection[str] = (),
    low: float = -math.inf,
    high: float = math.inf,
    parse: Callable[[Any], Any] | None = None,
    metavar: str = "",
) -> Any:
    """Declare a field of a dataclass: its default, help text, and the values that it may have.

    `choices` limits text, `low` and `high` limit numbers and each number of a tuple. `parse` converts what a
    file or a flag holds to the field's type and raises ValueError or argparse.ArgumentTypeError, with what
    the value must be, where it cannot. `metavar` names the value in --help.
    """
    metadata = {
        "help": help,
        "choices": choices,
        "low": low,
        "high": high,
        "parse": parse,
        "metavar": metavar,
    }
    return dataclasses.field(default=default, metadata=metadata)


def check_fields(instance: Any) -> None:
    """Check and convert every field of a dataclass that `option` declared; call it in `__post_init__`.

    Raises InputError for a value of the wrong type or out of range.
    """
    for field in dataclasses.fields(instance):
        value = _check_value(field, getattr(instance, field.name))
        object.__setattr__(instance, field.name, value)


def from_table(cls: type[T], table: Mapping[str, Any], *, where: str = "") -> T:
    """Return a `cls`, a dataclass of options, from a table as TOML or flags hold it.

    Errors start with `where`, such as "c.toml: [cached]". Raises InputError for an unknown or missing key and
    for a value that is not allowed.
    """
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]
    for key in table:
        check_key(key, [field.name for field in fields], where=where)
    for field in fields:
        if field.default is dataclasses.MISSING and field.name not in table:
            raise InputError(f"{_prefix(where)}{field.name} is missing")
    try:
        return cls(**table)
    except InputError as error:
        raise InputError(f"{_prefix(where)}{error}") from None


def add_option_arguments(
    parser: argparse._ActionsContainer,
    cls: type[Any],
    *,
    describe_default: Callable[[dataclasses.Field[Any]], str] | None = None,
) -> None:
    """Add a flag for each field of `cls`, --batch-size for `batch_size`; a missing flag leaves no attribute.

    --help shows the field's default, or what `describe_default` returns for the field.
    """
    for field in dataclasses.fields(cls):
        default = (describe_default or (lambda field: format_default(field.default)))(field)
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=_argument_type(field),
            default=argparse.SUPPRESS,
            metavar=field.metadata["metavar"]
            or "|".join(field.metadata["choices"])
            or field.name.split("_")[-1].upper(),
            help=field.metadata["help"] + (f" (default: {default})" if default else ""),
        )


def list_differing_fields(one: Any, other: Any) -> list[str]:
    """Return the names of the fields in which two instances of a dataclass differ."""
    names = [field.name for field in dataclasses.fields(one)]
    return [name for name in names if getattr(one, name) != getattr(other, name)]


def read_toml(path: Path | str, *, what: str = "configuration") -> dict[str, Any]:
    """Return the content of a TOML file; InputError, which calls it `what`, if it cannot be read."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {what} {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{what} {path} is not TOML: {error}") from error


def check_key(key: str, known: Collection[str], *, where: str = "") -> None:
    """Raise InputError unless `key` is one of `known`; the message suggests the closest one or lists all."""
    if key not in known:
        hint = suggest_closest(key, known) or f"; known: {', '.join(known)}"
        raise InputError(f"{_prefix(where)}unknown key {key!r}{hint}")


def check_choice(name: str, value: Any, choices: Collection[str]) -> str:
    """Return `value`, called `name`, if it is one of `choices`. Raises InputError."""
    if not isinstance(value, str) or value not in choices:
        raise InputError(
            f"{name} = {value!r} must be {format_choices(choices)}{suggest_closest(str(value), choices)}"
        )
    return value


def check_integer(name: str, value: Any, *, low: float = -math.inf, high: float = math.inf) -> int:
    """Return `value`, called `name`, if it is a whole number in [low, high]. Raises InputError."""
    if type(value) is not int or not low <= value <= high:
        raise InputError(f"{name} = {value!r} must be a whole number{format_limits(low, high)}")
    return value


def check_number(name: str, value: Any, *, low: float = -math.inf, high: float = math.inf) -> float:
    """Return `value`, called `name`, as a float if it is a number in [low, high]. Raises InputError."""
    if type(value) not in (int, float) or not math.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name} = {value!r} must be a number{format_limits(low, high)}")
    return float(value)


def suggest_closest(word: str, known: Collection[str]) -> str:
    """Return "; did you mean 'x'?" for the word of `known` that resembles `word`, or nothing."""
    close = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def format_choices(words: Collection[str]) -> str:
    """Return "a, b or c"."""
    words = list(words)
    return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else words[0]


def format_limits(low: float, high: float) -> str:
    """Return " between low and high", " from low up" and so on, for the end of "must be a number"."""
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f" from {low:.12g} up"
    return f" up to {high:.12g}" if math.isinf(low) else f" between {low:.12g} and {high:.12g}"


def format_default(value: Any) -> str:
    """Return a default as --help shows it: "224x224" for a size, nothing for None and for empty text."""
    if value is None or value in ("", argparse.SUPPRESS):
        return ""
    if isinstance(value, list | tuple):
        return ("x" if all(type(item) is int for item in value) else ", ").join(map(str, value))
    return str(value)


def _check_value(field: dataclasses.Field[Any], value: Any) -> Any:
    name, choices, parse = field.name, field.metadata["choices"], field.metadata["parse"]
    limits = {key: field.metadata[key] for key in ("low", "high")}
    if parse is not None:
        try:
            value = parse(value)
        except (ValueError, argparse.ArgumentTypeError) as error:
            raise InputError(f"{name} = {value!r} must be {error}") from None
        for number in value if isinstance(value, tuple) else ():
            check_number(name, number, **limits)
        return value
    if choices:
        return check_choice(name, value, choices)
    if field.type is int:
        return check_integer(name, value, **limits)
    if field.type is float:
        return check_number(name, value, **limits)
    if type(value) is not field.type:
        raise InputError(f"{name} = {value!r} must be {_TYPE_NAMES[field.type]}")
    return value


_TYPE_NAMES: dict[Any, str] = {str: "text", bool: "true or false", dict: "a table"}


def _argument_type(field: dataclasses.Field[Any]) -> Callable[[str], Any]:
    """Return the converter of a flag's text; what it gives is checked with the other fields."""
    if field.type is int:
        return _parse_integer
    return _parse_number if field.type is float else str


def _parse_integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _prefix(where: str) -> str:
    return f"{where} " if where else ""
