"""Make pictures for `train --data-service HOST:PORT` that runs elsewhere, where its machine is too slow to.

Start it on one machine, which then hands out the work, and with --join HOST:PORT on any number of others. It
has no password: use it in a network that you trust.
"""

import signal
import threading
from collections.abc import Sequence

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError

# isort: split
import tensorflow as tf


def main(arguments: Sequence[str]) -> None:
    """Start the servers, say where, and serve until stopped."""
    command = make_parser("serve", __doc__)
    command.add_argument(
        "--port", type=int, default=5050, metavar="N", help="where trainings ask for pictures"
    )
    command.add_argument("--join", metavar="HOST:PORT", help="work for the one that was started there")
    command.add_argument(
        "--host", default="localhost", metavar="NAME", help="this machine's name, as the trainer's reaches it"
    )
    options = command.parse_args(arguments)
    if options.json is not None:
        require_writable(options.json)
    # Held by name: a server stops when nothing refers to it.
    dispatcher = None if options.join else _start_dispatcher(options.port)
    port = options.port if dispatcher is None else dispatcher.target.rpartition(":")[2]
    address = options.join or f"{options.host}:{port}"
    worker = _start_worker(address, options.host)
    if options.json is not None:
        write_json(options.json, {"data_service": address})
    print(f"serving: python -m laesi_tf.train --data-service {address}", flush=True)
    _wait_for_stop_signal()
    del worker, dispatcher


def _start_dispatcher(port: int) -> tf.data.experimental.service.DispatchServer:
    try:
        return tf.data.experimental.service.DispatchServer(
            tf.data.experimental.service.DispatcherConfig(port=port)
        )
    except tf.errors.OpError as error:
        raise InputError(f"cannot listen on port {port}; choose another --port ({error.message})") from error


def _start_worker(address: str, host: str) -> tf.data.experimental.service.WorkerServer:
    """A worker on a free port; it waits for a dispatcher that is not there yet."""
    config = tf.data.experimental.service.WorkerConfig(
        dispatcher_address=address, worker_address=f"{host}:%port%"
    )
    return tf.data.experimental.service.WorkerServer(config)


def _wait_for_stop_signal() -> None:
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()


if __name__ == "__main__":
    run_command(main)
