"""Keep the memory of a command that handles large pictures close to what it uses."""

import contextlib
import ctypes
import sys

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8
"""Parameters of glibc's mallopt."""
_LARGE_BYTES = 2_000_000


def return_large_blocks() -> None:
    """Let glibc return each freed block of over 2 MB to the system at once, and share one heap among threads.

    By default it soon keeps freed blocks of up to 32 MB, in a heap for each thread. Nothing happens without
    glibc.
    """
    if sys.platform == "linux":
        # A system without glibc.
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL("libc.so.6")
            library.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
            library.mallopt(_ARENA_MAX, 1)
