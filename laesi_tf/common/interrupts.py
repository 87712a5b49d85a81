"""Let a loop finish its current step after Ctrl-C."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def defer_interrupt(notify: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether Ctrl-C was pressed inside this context.

    The first Ctrl-C calls `notify` and interrupts nothing; a second one raises KeyboardInterrupt. Nothing
    changes outside the main thread, or where the program handles or ignores Ctrl-C itself.
    """
    was_pressed = False

    def handle(_signal: int, _frame: FrameType | None) -> None:
        nonlocal was_pressed
        if was_pressed:
            raise KeyboardInterrupt
        was_pressed = True
        notify()

    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield lambda: False
        return
    signal.signal(signal.SIGINT, handle)
    try:
        yield lambda: was_pressed
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
