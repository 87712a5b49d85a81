"""The argument parser that all commands share."""

import argparse
import sys
from pathlib import Path

from laesi_tf.common.atomic_files import require_writable
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import format_default

_JSON_SUFFIXES = (".json", ".jsonl", ".ndjson")
"""Files that may be replaced; others may be a photo or a list of the user's."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise InputError(f"{message}; see --help")


class _HelpFormatter(argparse.HelpFormatter):
    """Help with defaults as one would type them: 224x224 for a tuple; none where there is nothing to show."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        shown = format_default(action.default)
        takes_value = bool(action.option_strings) and action.nargs != 0
        if not shown or not takes_value or not action.help or "default" in action.help:
            return action.help
        return f"{action.help} (default: {shown.replace('%', '%%')})"


def make_parser(
    command: str, description: str | None, *, package: str = "laesi_tf", has_json: bool = True
) -> argparse.ArgumentParser:
    """Return a parser for a command, whose --help shows defaults and that takes --json FILE if `has_json`."""
    parser = _Parser(
        prog=format_command(command, package=package),
        description=description,
        formatter_class=_HelpFormatter,
        allow_abbrev=False,
    )
    if has_json:
        parser.add_argument(
            "--json", type=output_file, metavar="FILE", help="also write the figures as JSON to FILE"
        )
    return parser


def output_file(text: str) -> Path:
    """Parse the path of a file to be written, as an argument's type.

    Its folder must be writable, and a file that exists must be JSON by its name.
    """
    path = Path(text)
    if not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(
            f"cannot write {path}: there is no folder {path.parent}; make it first"
        )
    if path.is_file() and path.suffix.lower() not in _JSON_SUFFIXES:
        raise argparse.ArgumentTypeError(f"{path} exists and is no JSON file; name another file")
    try:
        require_writable(path)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return path


def format_command(command: str, *, package: str = "laesi_tf") -> str:
    """Return how the user calls `command`: "laesi predict" or "python -m laesi_tf.predict"."""
    program = Path(sys.argv[0]).stem if sys.argv else ""
    return (
        f"laesi {command}"
        if program == "laesi" and package == "laesi_tf"
        else f"python -m {package}.{command}"
    )
