"""The devices that train one network together, by tf.distribute.

The batch size is that of all devices together: replica r of n takes the r-th of n equal, contiguous parts of
every batch. A step is thus the same step on any number of devices, the learning rate needs no scaling, and a
run continues on another number of devices than it was started on.
"""

import contextlib
import enum
import faulthandler
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from laesi_tf.common.errors import InputError
from laesi_tf.data.batch_part import WHOLE_BATCH, BatchPart
from laesi_tf.training.cluster import VARIABLE, Cluster, read_cluster
from laesi_tf.training.config import MIRRORED, NONE, TrainConfig
from laesi_tf.training.run_directory import digest_config
from laesi_tf.training.trainer import BatchStream

_LOST = (
    tf.errors.UnavailableError,
    tf.errors.AbortedError,
    tf.errors.CancelledError,
    tf.errors.DeadlineExceededError,
)


_JOIN_TIMEOUT_S = 120


class WorkerLost(InputError):
    """Another process of the training ended or cannot be reached."""


class Start(enum.IntEnum):
    """What the chief found in the run directory."""

    TRAIN = 0
    FINISHED = 1
    REFUSED = 2


class Replicas:
    """The devices of a strategy: some or all of them in this process, which makes `part` of every batch."""

    def __init__(
        self,
        name: str = NONE,
        strategy: tf.distribute.Strategy | None = None,
        part: BatchPart = WHOLE_BATCH,
        cluster: Cluster | None = None,
    ) -> None:
        self.name, self.part, self._cluster = name, part, cluster
        self.strategy: Any = strategy
        self.count: int = strategy.num_replicas_in_sync if strategy else 1
        self._sum = tf.function(self._sum_replicas)

    @property
    def is_chief(self) -> bool:
        """Whether this process validates the network and writes the run; the others only train."""
        return self.part.index == 0

    def describe(self) -> dict[str, Any]:
        """Return the entries about these devices in config.toml and metrics.json of a run."""
        return {"strategy": self.name, "replicas": self.count}

    def scope(self) -> AbstractContextManager[Any]:
        """Return the context in which variables are created on all devices."""
        return self.strategy.scope() if self.strategy else contextlib.nullcontext()

    def take_part(self, stream: BatchStream) -> BatchStream:
        """Return the stream of this process's parts of the batches (image, target) of `stream`."""
        if self.part.count == 1:
            return stream

        def take(values: tf.Tensor) -> tf.Tensor:
            first = self.part.first(len(values))
            return values[first : first + self.part.size(len(values))]

        return lambda start: ((take(images), take(target)) for images, target in stream(start))

    def split(self, values: tf.Tensor) -> tf.Tensor:
        """Divide `values` [B, ...], this process's part of a batch, among its devices."""
        if isinstance(values, tf.distribute.DistributedValues):
            return values  # made on the devices
        local = self.count // self.part.count
        size = len(values) // local

        def take(context: tf.distribute.experimental.ValueContext) -> tf.Tensor:
            first = context.replica_id_in_sync_group % local * size
            return values[first : first + size]

        return self.strategy.experimental_distribute_values_from_function(take)

    def share(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the chief's `values`, float64 [N], in every process. Raises WorkerLost."""
        return self.sum(values if self.is_chief else np.zeros_like(values))

    def sum(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the sum over processes of `values`, float64 [N]. Raises WorkerLost."""
        if self.part.count == 1:
            return values
        local = self.count // self.part.count

        def take(context: tf.distribute.experimental.ValueContext) -> tf.Tensor:
            return tf.constant(values * (context.replica_id_in_sync_group % local == 0))

        with self.report_lost_workers():
            total: NDArray[Any] = self._sum(
                self.strategy.experimental_distribute_values_from_function(take)
            ).numpy()
        return total

    def share_start(self, start: Start, config: TrainConfig) -> Start:
        """Return what the chief found. Raises InputError if it has another configuration, or refused."""
        digest = digest_config(config)
        chief_start, chief_digest = self.share(np.array([start, digest], np.float64))
        if chief_digest != digest:
            raise InputError(
                "the chief has another configuration; give every worker the same flags and files"
            )
        if chief_start == Start.REFUSED and not self.is_chief:
            raise InputError("the chief could not start; its own message says why")
        return Start(int(chief_start))

    def share_variables(self, variables: Sequence[Any]) -> None:
        """Set `variables`, the same ones in every process, to the values of the chief."""
        if self.part.count == 1:
            return
        values = [variable.numpy() for variable in variables]
        # float64 holds float32 and step counts exactly.
        flat = self.share(np.concatenate([np.ravel(value).astype(np.float64) for value in values]))
        parts = np.split(flat, np.cumsum([value.size for value in values])[:-1])
        with self.scope():
            for variable, value, part in zip(variables, values, parts, strict=True):
                variable.assign(part.reshape(value.shape).astype(value.dtype))

    def share_progress(self, step: int, *, is_finished: bool) -> tuple[int, bool]:
        """Return how many steps the chief has done, and whether the run is finished with them."""
        chief_step, chief_finished = self.share(np.array([step, is_finished], np.float64))
        return int(chief_step), bool(chief_finished)

    def agree(self, *, is_finished: bool, is_stopped: bool) -> tuple[bool, bool]:
        """Return whether the chief is finished, and whether any process was asked to stop."""
        if self.part.count == 1:
            return is_finished, is_stopped
        finished, stopped = self.sum(np.array([is_finished and self.is_chief, is_stopped], np.float64))
        return bool(finished), bool(stopped)

    @contextlib.contextmanager
    def report_lost_workers(self) -> Iterator[None]:
        """Turn the errors with which collective operations end into WorkerLost."""
        if self._cluster is None:
            yield
            return
        try:
            yield
        except _LOST as error:
            raise WorkerLost(f"lost {_name_lost_workers(str(error), self._cluster)}") from error

    def _sum_replicas(self, values: tf.Tensor) -> tf.Tensor:
        total = self.strategy.run(tf.identity, args=(values,))
        return self.strategy.reduce(tf.distribute.ReduceOp.SUM, total, axis=None)


ONE_DEVICE = Replicas()


def start_replicas(name: str, config: TrainConfig, notify: Callable[[str], None]) -> Replicas:
    """Return the replicas of a strategy of STRATEGIES, before TensorFlow has used any device.

    `multi-worker` reads TF_CONFIG and waits for all workers; `notify` gets a line for each. Raises InputError
    for a batch that cannot be divided, fewer than two devices, or a cluster that cannot be used.
    """
    if name == NONE:
        return ONE_DEVICE
    if name == MIRRORED:
        devices = _list_devices()
        if len(devices) < 2:
            raise InputError(
                f"--strategy mirrored needs two devices or more, and TensorFlow sees {len(devices)} "
                f"({', '.join(devices)}); leave out --strategy"
            )
        _check_batch(config, BatchPart(0, len(devices)), "devices")
        return Replicas(name, tf.distribute.MirroredStrategy(devices))
    cluster = read_cluster(os.environ.get(VARIABLE))
    part = BatchPart(cluster.index, len(cluster.addresses))
    _check_parts(config, part)
    cluster.wait_for_all(notify)
    return Replicas(name, _join_cluster(notify), part, cluster)


def _join_cluster(notify: Callable[[str], None]) -> tf.distribute.Strategy:
    """Connect to the other processes, which have all started.

    TensorFlow waits without end for one that stopped since, and while it does, no Python code and no handler
    of a signal runs; only faulthandler's own thread can end the process then.
    """
    notify(f"joining the other workers; without their answer this process ends after {_JOIN_TIMEOUT_S} s")
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(_JOIN_TIMEOUT_S, exit=True, file=nowhere)
        try:
            strategy = tf.distribute.MultiWorkerMirroredStrategy()
        except _LOST as error:
            raise WorkerLost(f"the workers could not connect ({str(error).splitlines()[0]})") from error
        finally:
            faulthandler.cancel_dump_traceback_later()
    if threading.current_thread() is threading.main_thread():
        # TensorFlow's own handler of SIGTERM would keep this process running.
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return strategy


def _list_devices() -> list[str]:
    """Return all accelerators, or all processors where there is none."""
    for kind in ("GPU", "CPU"):
        names = [device.name.removeprefix("/device:") for device in tf.config.list_logical_devices(kind)]
        if names:
            return names
    return []


def _check_parts(config: TrainConfig, part: BatchPart) -> None:
    """Raise InputError if workers cannot make the parts of a batch."""
    devices = part.count * max(1, len(tf.config.list_physical_devices("GPU")))
    _check_batch(config, BatchPart(0, devices), "devices of all workers")
    if part.size(config.batch_size) % config.lighting_passes:
        raise InputError(
            f"each of {part.count} workers makes {part.size(config.batch_size)} images of a batch, which "
            f"must be a multiple of lighting_passes = {config.lighting_passes}; choose another --batch-size"
        )
    if config.copy_paste:
        raise InputError(
            "--copy-paste needs the whole batch, of which each worker makes a part; leave out --copy-paste "
            "or choose --strategy mirrored"
        )


def _check_batch(config: TrainConfig, part: BatchPart, what: str) -> None:
    if config.batch_size % part.count:
        raise InputError(
            f"batch_size = {config.batch_size} must be a multiple of the {part.count} {what}, among which "
            "each batch is divided; choose another --batch-size"
        )


def _name_lost_workers(message: str, cluster: Cluster) -> str:
    """Return the workers that an error of TensorFlow names, or "another worker"."""
    found = re.findall(r"/job:(chief|worker)/(?:replica:0/)?task:(\d+)", message)
    numbers = {int(task) + (cluster.chiefs if job == "worker" else 0) for job, task in found} - {
        cluster.index
    }
    if len(numbers) != 1:
        return "another worker"
    (number,) = numbers
    return f"worker {number} at {cluster.addresses[number]}"
