"""Render scenes for `train --data-service HOST:PORT` on other machines, if one machine is too slow.

Start it on one machine, which then distributes the work, and with --join HOST:PORT on any number of others.

Security: TensorFlow's data service has no password and listens on every network interface. Whoever reaches
its ports can read any file that the user who runs it can read, by sending a dataset that reads it. So it
starts only with --trust-network. Fence it: a firewall that admits only the training machines, an SSH tunnel,
or a container without mounted folders.
"""

import argparse
import signal
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.network import parse_address, parse_port, wait_until_reachable

if TYPE_CHECKING:
    import tensorflow as tf

_JOIN_TIMEOUT_S = 30.0
"""Both machines may be started at the same time; TensorFlow itself would wait for ever."""


def main(arguments: Sequence[str]) -> None:
    """Start the servers, print their address, and serve until stopped. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    if not options.trust_network:
        raise InputError(
            "every machine that reaches this server can read all files that you can read; "
            "protect its ports as --help says, then start it with --trust-network"
        )
    if options.join:
        wait_until_reachable(options.join, timeout_s=_JOIN_TIMEOUT_S)
    load_tensorflow()
    # The names keep the servers alive: a server stops when nothing refers to it.
    dispatcher = None if options.join else _start_dispatcher(options.port)
    port = options.port if dispatcher is None else dispatcher.target.rpartition(":")[2]
    address = options.join or f"{options.host}:{port}"
    worker = _start_worker(address, options.host)
    if options.json is not None:
        write_json(options.json, {"data_service": address})
    print(f"serving: python -m laesi_tf.train --data-service {address}", flush=True)
    _wait_for_stop_signal()
    del worker, dispatcher


def _start_dispatcher(port: int) -> "tf.data.experimental.service.DispatchServer":
    import tensorflow as tf

    try:
        return tf.data.experimental.service.DispatchServer(
            tf.data.experimental.service.DispatcherConfig(port=port)
        )
    except tf.errors.OpError as error:
        raise InputError(f"cannot listen on port {port}; choose another --port ({error.message})") from error


def _start_worker(address: str, host: str) -> "tf.data.experimental.service.WorkerServer":
    """Start a worker of the dispatcher at `address`, on a free port of this machine, called `host`."""
    import tensorflow as tf

    config = tf.data.experimental.service.WorkerConfig(
        dispatcher_address=address, worker_address=f"{host}:%port%"
    )
    return tf.data.experimental.service.WorkerServer(config)


def _wait_for_stop_signal() -> None:
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("serve", __doc__)
    parser.add_argument(
        "--trust-network",
        action="store_true",
        help="start although every machine that reaches the ports can read all files that you can read",
    )
    parser.add_argument(
        "--port",
        type=parse_port,
        default=5050,
        metavar="N",
        help="port on which this machine distributes the work",
    )
    parser.add_argument(
        "--join", type=_address, metavar="HOST:PORT", help="work for the server that was started there"
    )
    parser.add_argument(
        "--host",
        default="localhost",
        metavar="NAME",
        help="name of this machine, by which the training machine reaches it",
    )
    return parser


def _address(text: str) -> str:
    try:
        parse_address(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


if __name__ == "__main__":
    run_command(main)
