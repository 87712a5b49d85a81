"""Run a command: exit status, error and warning messages."""

import logging
import sys
import warnings
from collections.abc import Callable, Sequence

from laesi_tf.common.errors import InputError


def run_command(main: Callable[[Sequence[str]], None]) -> None:
    """Call `main` with the command line and turn bad input and Ctrl-C into one line on stderr.

    Exit status: 0 done, 2 bad input, 130 Ctrl-C. Any other exception is a fault of ours: it keeps its
    traceback and ends with status 1.
    """
    warnings.showwarning = _print_warning
    # Pillow warns of damaged metadata and of large images; neither prevents a measurement. What it logs about
    # damaged files is in our message.
    warnings.filterwarnings("ignore", module=r"PIL\.")
    logging.getLogger("PIL").setLevel(logging.CRITICAL)
    try:
        main(sys.argv[1:])
    except InputError as error:
        _print_message(f"error: {error}")
        raise SystemExit(2) from None
    except KeyboardInterrupt as interruption:
        _print_message(str(interruption) or "interrupted")
        raise SystemExit(130) from None


def _print_warning(message: Warning | str, *_: object, **__: object) -> None:
    _print_message(f"warning: {message}")


def _print_message(message: str) -> None:
    """Print one line to stderr, or nothing where stderr is closed."""
    if sys.stderr is not None:
        print(" ".join(message.split()), file=sys.stderr)
