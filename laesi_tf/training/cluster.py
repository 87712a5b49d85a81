"""The processes of a training on several machines, as TensorFlow's variable TF_CONFIG lists them.

Nothing here needs TensorFlow, so that a wrong TF_CONFIG and a worker that is missing are found before
TensorFlow waits for it: its own wait has no end, and answers neither Ctrl-C nor SIGTERM.
"""

import json
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from laesi_tf.common.errors import InputError
from laesi_tf.common.network import parse_address, wait_until_reachable

VARIABLE = "TF_CONFIG"
_EXAMPLE = '{"cluster": {"worker": ["host0:12345", "host1:12345"]}, "task": {"type": "worker", "index": 0}}'
_START_TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Cluster:
    """The addresses (HOST:PORT) of all processes, the chief's first, and the `index` of this one."""

    addresses: tuple[str, ...]
    index: int
    chiefs: int = 0
    """1 where TF_CONFIG has a job `chief`; otherwise the first worker is the chief."""

    def wait_for_all(self, notify: Callable[[str], None], *, timeout_s: float = _START_TIMEOUT_S) -> None:
        """Wait until every process has started. Raises InputError if one has not after `timeout_s`."""
        host, port = parse_address(self.addresses[self.index])
        try:
            # Any address: inside a container or behind NAT, `host` is not one of this machine's.
            listener = socket.create_server(("", port))
        except OSError as error:
            raise InputError(
                f"cannot listen on port {port} of {host} ({error.strerror or error}); "
                f"name a free port in {VARIABLE}, the same for all workers"
            ) from error
        with listener:
            for number, address in enumerate(self.addresses):
                if number != self.index:
                    notify(f"waiting for worker {number} at {address}")
                    wait_until_reachable(
                        address,
                        timeout_s=timeout_s,
                        missing=f"worker {number} does not answer",
                        advice=f"start the same command there, with its own index in {VARIABLE}",
                    )


def read_cluster(text: str | None) -> Cluster:
    """Return the cluster that a value of TF_CONFIG describes. Raises InputError."""
    if not text:
        raise InputError(f"--strategy multi-worker needs {VARIABLE} in the environment, such as '{_EXAMPLE}'")
    try:
        values = json.loads(text)
    except ValueError as error:
        raise InputError(f"{VARIABLE} is not JSON ({error}); write it as '{_EXAMPLE}'") from None
    jobs, task = _get_table(values, "cluster"), _get_table(values, "task")
    if unknown := sorted(set(jobs) - {"chief", "worker"}):
        raise InputError(f"{VARIABLE} lists the job {unknown[0]!r}; only 'chief' and 'worker' train")
    for job, listed in jobs.items():
        if not isinstance(listed, list) or not all(isinstance(address, str) for address in listed):
            raise InputError(f"{VARIABLE}: {job!r} must be a list of HOST:PORT, as in '{_EXAMPLE}'")
    chiefs, workers = jobs.get("chief", []), jobs.get("worker", [])
    addresses = (*chiefs, *workers)
    if len(chiefs) > 1 or len(addresses) < 2:
        raise InputError(
            f"{VARIABLE} lists {len(chiefs)} chiefs and {len(workers)} workers; multi-worker needs two "
            "processes or more, at most one of them a chief; for one machine leave out --strategy or "
            "choose mirrored"
        )
    if len(set(addresses)) < len(addresses):
        raise InputError(f"{VARIABLE} lists an address twice: {', '.join(addresses)}")
    for address in addresses:
        parse_address(address)
    kind, index = task.get("type"), task.get("index")
    if kind not in jobs or type(index) is not int or not 0 <= index < len(jobs[kind]):
        raise InputError(
            f"{VARIABLE}: task {kind!r} {index!r} is not one of its cluster's {len(addresses)} processes"
        )
    return Cluster(addresses, index + (len(chiefs) if kind == "worker" else 0), len(chiefs))


def _get_table(values: Any, name: str) -> dict[str, Any]:
    table = values.get(name) if isinstance(values, dict) else None
    if not isinstance(table, dict):
        raise InputError(f"{VARIABLE} has no table {name!r}; write it as '{_EXAMPLE}'")
    return table
