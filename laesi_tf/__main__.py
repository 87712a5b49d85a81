"""The console script `laesi`: `laesi predict photos/` is `python -m laesi_tf.predict photos/`."""

import argparse
import ast
import importlib
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from laesi_tf.cli.console import run_command
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import check_choice

COMMANDS = (
    "predict",
    "evaluate",
    "train",
    "preview",
    "generate",
    "inpaint",
    "filter",
    "serve",
    "export",
    "web",
    "sheet",
    "similarity",
    "benchmark",
    "stress",
    "ablate",
)


def main() -> None:
    """Run the command that the first argument names, with the others."""
    run_command(_dispatch)


def _dispatch(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="laesi",
        description="Leaf area in cm2 from one photo on millimetre paper.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="\n".join(["commands:", *(f"  {name:12}{_summary(name)}" for name in COMMANDS)]),
        usage="laesi COMMAND [arguments of the command]",
    )
    version = metadata.version("laesi_tf")
    parser.add_argument("--version", action="version", version=f"laesi_tf {version}")
    parser.add_argument("command", metavar="COMMAND", help="one of those below; each has its own --help")
    if not arguments:
        parser.print_help()
        raise InputError("a command is missing")
    name = parser.parse_args(arguments[:1]).command
    check_choice("command", name, COMMANDS)
    importlib.import_module(f"laesi_tf.{name}").main(arguments[1:])


def _summary(name: str) -> str:
    """Return the first line of a command's docstring, read without importing it."""
    source = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


if __name__ == "__main__":
    sys.argv[0] = "laesi"
    main()
