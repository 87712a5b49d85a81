"""Parse the numbers, image sizes, shares and names of command-line flags.

Functions of one text are a `type` for argparse.
"""

import argparse
import math
from collections.abc import Iterable
from typing import Protocol, TypeVar

from laesi_tf.common.errors import InputError


class HasName(Protocol):
    """Something that a flag names."""

    @property
    def name(self) -> str:
        """Its name."""
        ...


Named = TypeVar("Named", bound=HasName)


def positive_int(text: str) -> int:
    """Parse a whole number from 1 up."""
    if not text.isdigit() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 up")
    return int(text)


def non_negative_int(text: str) -> int:
    """Parse a whole number from 0 up, such as a seed."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 up")
    return int(text)


def positive_float(text: str, *, most: float = math.inf, what: str = "number") -> float:
    """Parse a number above 0 and up to `most`; messages call it `what`."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (0.0 < value <= most and math.isfinite(value)):
        bound = "" if math.isinf(most) else f" and up to {most:g}"
        raise argparse.ArgumentTypeError(f"{text!r} is not a {what} above 0{bound}")
    return value


def image_size(text: str) -> tuple[int, int]:
    """Parse `224` or `480x640` as (height, width) in pixels."""
    parts = text.lower().split("x")
    if len(parts) > 2 or not all(part.isdigit() and 16 <= int(part) <= 8192 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not a side or HEIGHTxWIDTH between 16 and 8192 pixels")
    return int(parts[0]), int(parts[-1])


def select_by_name(items: Iterable[Named], names: Iterable[str], what: str) -> list[Named]:
    """Return the items of these names, each once, or all without any; messages call one `what`.

    Raises InputError for a name that no item has.
    """
    known = {item.name: item for item in items}
    chosen = list(dict.fromkeys(names)) or list(known)
    if unknown := [name for name in chosen if name not in known]:
        listed = ", ".join(repr(name) if "," in name else name for name in known)
        raise InputError(f"no {what} is called {unknown[0]!r}; there are {listed}")
    return [known[name] for name in chosen]


def shard_fraction(text: str) -> tuple[int, int]:
    """Parse `I/N`, part I of N counted from 0, as (I, N)."""
    index, _, parts = text.partition("/")
    if not (index.isdigit() and parts.isdigit() and int(index) < int(parts)):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with I from 0 to N - 1")
    return int(index), int(parts)
