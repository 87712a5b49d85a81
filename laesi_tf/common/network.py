"""Network addresses: parse HOST:PORT and check that a server listens there."""

import argparse
import socket
import time

from laesi_tf.common.errors import InputError

_CONNECT_TIMEOUT_S = 5.0
_RETRY_S = 0.5


def parse_port(text: str) -> int:
    """Parse a port number; a `type` for argparse."""
    if not text.isdecimal() or not 0 < int(text) < 2**16:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port from 1 to 65535")
    return int(text)


def parse_port_or_any(text: str) -> int:
    """Parse a port number, or 0 for any free port; a `type` for argparse."""
    return 0 if text == "0" else parse_port(text)


def parse_address(address: str) -> tuple[str, int]:
    """Split HOST:PORT. Raises InputError."""
    host, _, port = address.rpartition(":")
    try:
        number = parse_port(port)
    except argparse.ArgumentTypeError:
        number = 0
    if not host or not number:
        raise InputError(f"{address!r} is not HOST:PORT with a port from 1 to 65535")
    return host, number


def check_reachable(address: str) -> None:
    """Raise InputError if `address` is not HOST:PORT or nothing listens there."""
    wait_until_reachable(address, timeout_s=0.0)


def wait_until_reachable(
    address: str,
    *,
    timeout_s: float,
    missing: str = "no data service answers",
    advice: str = "start one with python -m laesi_tf.serve",
) -> None:
    """Wait until something listens at `address` (HOST:PORT).

    Raises InputError, which says what is `missing` and gives `advice`, if nothing does after `timeout_s`
    seconds; at once if the host is unknown.
    """
    target = parse_address(address)
    deadline = time.monotonic() + timeout_s
    while True:
        try:
            socket.create_connection(target, timeout=_CONNECT_TIMEOUT_S).close()
            return
        except OSError as error:
            if isinstance(error, socket.gaierror) or time.monotonic() >= deadline:
                raise InputError(f"{missing} at {address} ({error.strerror or error}); {advice}") from error
        time.sleep(_RETRY_S)
