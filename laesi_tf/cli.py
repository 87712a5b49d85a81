"""What all commands share: the parser's shape, the exit status, the progress bar and `--json`."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from laesi_tf.errors import InputError

Item = TypeVar("Item")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise InputError(f"{message}; see --help")


def parser(command: str, description: str | None) -> argparse.ArgumentParser:
    """A parser for `python -m laesi_tf.<command>` whose --help shows defaults and that takes --json FILE."""
    made = _Parser(
        prog=f"python -m laesi_tf.{command}",
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
        allow_abbrev=False,
    )
    made.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON to FILE")
    return made


def run(main: Callable[[Sequence[str]], None]) -> None:
    """Call `main` with the command line; a user's mistake becomes one line on stderr and exit status 2."""
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def progress(items: Iterable[Item], **options: Any) -> Iterable[Item]:
    """A progress bar on stderr that stays away from anything shorter than two seconds."""
    return tqdm(items, delay=2, dynamic_ncols=True, **options)


def size(text: str) -> tuple[int, int]:
    """Parse `224` or `480x640` as (height, width) in pixels."""
    parts = text.lower().split("x")
    if len(parts) > 2 or not all(part.isdigit() and 16 <= int(part) <= 8192 for part in parts):
        raise InputError(f"size {text!r} is not a side or HEIGHTxWIDTH between 16 and 8192 pixels")
    return int(parts[0]), int(parts[-1])
