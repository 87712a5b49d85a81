"""The argument parser that all commands share."""

import argparse
from pathlib import Path

from laesi_tf.common.errors import InputError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise InputError(f"{message}; see --help")


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default is None else super()._get_help_string(action)


def make_parser(
    command: str, description: str | None, *, package: str = "laesi_tf"
) -> argparse.ArgumentParser:
    """A parser for `python -m <package>.<command>` whose --help shows defaults and that takes --json FILE."""
    made = _Parser(
        prog=f"python -m {package}.{command}",
        description=description,
        formatter_class=_HelpFormatter,
        allow_abbrev=False,
    )
    made.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON to FILE")
    return made
