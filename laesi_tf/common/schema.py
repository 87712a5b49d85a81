"""What the readers of TOML files and flags share: reading a file, and messages that name the closest known word."""

import difflib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.common.errors import InputError


def read_toml(path: Path | str) -> dict[str, Any]:
    """The values in a TOML file, its provenance table included; InputError if it is missing or not TOML."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read configuration {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"configuration {path} is not TOML: {error}") from error


def suggest_closest(word: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1)
    return f", did you mean {close[0]!r}?" if close else ""


def format_choices(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"
