"""Run a command: exit status, error and warning messages."""

import sys
import warnings
from collections.abc import Callable, Sequence

from laesi_tf.common.errors import InputError


def run_command(main: Callable[[Sequence[str]], None]) -> None:
    """Call `main` with the command line; a user's mistake becomes one line on stderr and exit status 2."""
    warnings.showwarning = _print_warning
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def _print_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)
