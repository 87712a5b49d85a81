"""What all commands share: the parser's shape, the exit status, the progress bar and `--json`.

Commands import this before anything that imports TensorFlow: it brings TensorFlow in without its chatter.
"""

import argparse
import contextlib
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from laesi_tf.errors import InputError

Item = TypeVar("Item")


@contextlib.contextmanager
def _stderr_aside() -> Iterator[None]:
    """Send file descriptor 2 to nowhere for the duration."""
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


# While it is imported and looks for GPUs TensorFlow writes seven lines about oneDNN and CUDA to stderr
# whatever its log level; after that the level keeps it to warnings.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
with _stderr_aside():
    import tensorflow

    tensorflow.config.list_physical_devices()


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise InputError(f"{message}; see --help")


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default is None else super()._get_help_string(action)


def parser(command: str, description: str | None, *, package: str = "laesi_tf") -> argparse.ArgumentParser:
    """A parser for `python -m <package>.<command>` whose --help shows defaults and that takes --json FILE."""
    made = _Parser(
        prog=f"python -m {package}.{command}",
        description=description,
        formatter_class=_Help,
        allow_abbrev=False,
    )
    made.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON to FILE")
    return made


def add_models(made: argparse.ArgumentParser) -> None:
    """Add the options that name the models a command measures with."""
    made.add_argument(
        "--model",
        type=Path,
        metavar="RUN|rule_based",
        help="training run that measures, or Easy Leaf Area's rules, which need a red square of 4 cm2 in the "
        "photo (default: the runs that come with the package)",
    )
    made.add_argument(
        "--mask-model", type=Path, metavar="RUN", help="training run of task mask: the ruling is read too"
    )


def run(main: Callable[[Sequence[str]], None]) -> None:
    """Call `main` with the command line; a user's mistake becomes one line on stderr and exit status 2."""
    warnings.showwarning = _one_line
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def _one_line(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


def progress(items: Iterable[Item], **options: Any) -> Iterable[Item]:
    """A progress bar on stderr that stays away from anything shorter than two seconds."""
    return tqdm(items, delay=2, dynamic_ncols=True, **options)


def positive(text: str) -> int:
    """Parse a whole number from 1 up, as an argument's type."""
    if not text.isdigit() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 up")
    return int(text)


def above_zero(text: str, *, most: float = math.inf, what: str = "number") -> float:
    """Parse a number above 0 and up to `most`, as an argument's type; a user knows it as `what`."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (0.0 < value <= most and math.isfinite(value)):
        bound = "" if math.isinf(most) else f" and up to {most:g}"
        raise argparse.ArgumentTypeError(f"{text!r} is not a {what} above 0{bound}")
    return value


def size(text: str) -> tuple[int, int]:
    """Parse `224` or `480x640` as (height, width) in pixels, as an argument's type."""
    parts = text.lower().split("x")
    if len(parts) > 2 or not all(part.isdigit() and 16 <= int(part) <= 8192 for part in parts):
        told = f"size {text!r} is not a side or HEIGHTxWIDTH between 16 and 8192 pixels"
        raise argparse.ArgumentTypeError(told)
    return int(parts[0]), int(parts[-1])
