"""Where a study is kept: a local file, or PostgreSQL for many workers and machines.

Both are Optuna's RDBStorage, the file being SQLite's: a transaction is whole or absent however a worker
ends, and heartbeats tell who is alive. (Optuna's journal file has neither: a line cut off by a kill makes
all after it unreadable.) What RDBStorage leaves open is closed here: SQLite does not lock a trial while it
is claimed, and several steps that belong together are several transactions. So they are done under one lock
of the study, which the system takes back from a worker that dies.
"""

import contextlib
import fcntl
import math
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import optuna
import sqlalchemy
from optuna.exceptions import ExperimentalWarning, StorageInternalError
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

from laesi_tf.common.errors import InputError

DEFAULT_STORAGE = "runs/sweep/study.db"
"""Where a sweep is kept unless it is told otherwise."""


def artifact_folder(storage: str) -> Path:
    """The folder of artifacts and checkpoints that goes with a storage: where its file is."""
    return Path(DEFAULT_STORAGE if "://" in storage else storage).parent


# What Optuna says of every trial the ledger keeps.
optuna.logging.set_verbosity(optuna.logging.WARNING)

Result = TypeVar("Result")
_LOCK_TIMEOUT_S = 60
"""No one holds the lock for longer than it takes to write the study down."""
# A connection whose other end is silently gone breaks in seconds instead of hanging.
_CONNECTION_OPTIONS = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "tcp_user_timeout": 20_000,
    # The server as well: it must not keep the lock of a machine that has gone.
    "options": "-c tcp_keepalives_idle=10 -c tcp_keepalives_interval=5 -c tcp_keepalives_count=4",
}
_SQLITE_PRAGMAS = ("PRAGMA journal_mode=WAL", "PRAGMA synchronous=NORMAL")


@dataclass(frozen=True)
class RetryPolicy:
    """What becomes of trials that do not end well.

    A job is tried again `retries` times at most. A trial is ended after `time_limit_s` of training, and
    given up for lost when its worker has not been heard of for `grace_s`. A worker waits `patience_s` for a
    database that does not answer.
    """

    retries: int = 3
    time_limit_s: float = 300.0
    heartbeat_s: int = 10
    grace_s: int = 60
    patience_s: float = 300.0

    def __post_init__(self) -> None:
        if self.retries < 0 or not self.time_limit_s > 0:
            raise InputError(f"{self.retries} retries or {self.time_limit_s:g} s are not to be had")


class StorageUnreachable(Exception):
    """The database did not answer for as long as the rules allow."""


class StudyStorage:
    """An open storage: Optuna's `storage`, the lock of all its workers, patience with its connection.

    `away_at` is the monotonic time at which the database was last found away.
    """

    def __init__(self, where: str, rules: RetryPolicy) -> None:
        self.where, self.rules = where, rules
        url, self._lock, options = _open_storage(where)
        self.interruption, self.away_at = "", -math.inf
        try:
            # Under the lock, as two that make the tables at once would be in each other's way.
            with self._lock(), warnings.catch_warnings():
                warnings.simplefilter("ignore", ExperimentalWarning)
                self.storage = optuna.storages.RDBStorage(
                    url, options, heartbeat_interval=rules.heartbeat_s, grace_period=rules.grace_s
                )
        except DBAPIError as error:
            raise InputError(f"cannot open the storage: {_first_line(error)}") from error
        if url.startswith("sqlite"):
            sqlalchemy.event.listen(self.storage.engine, "connect", _set_sqlite_pragmas)
            self.storage.engine.dispose()

    def lock(self) -> AbstractContextManager[None]:
        """One worker at a time: for what must not happen between two transactions."""
        return self._lock()

    def patiently(self, act: Callable[[], Result]) -> Result:
        """The result of `act`, which is done again while the database is away. Raises Unreachable.

        Whatever `act` does may have been done already when the connection broke. The last interruption is
        told in `interruption` until someone clears it.
        """
        lost_at, pause = 0.0, 0.1
        while True:
            try:
                return act()
            except (StorageInternalError, DBAPIError) as error:
                if not _is_connection_error(error):
                    raise
                self.away_at = time.monotonic()
                lost_at = lost_at or self.away_at
                away_s = self.away_at - lost_at
                self.interruption = f"database away, for {away_s:.1f} s so far: {_first_line(error)}"
                if away_s > self.rules.patience_s:
                    raise StorageUnreachable(self.interruption) from error
                time.sleep(pause)
                pause = min(5.0, 2 * pause)


def _open_storage(where: str) -> tuple[str, Callable[[], AbstractContextManager[None]], dict[str, Any]]:
    """SQLAlchemy's URL, the lock, and the engine's options."""
    kind, found, rest = where.partition("://")
    if not found:
        path = Path(where).absolute()
        if path.is_dir():
            raise InputError(f"storage {where} is a folder; name a file in it")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the folder of storage {where}: {error.strerror}") from error
        lock = path.with_name(path.name + ".lock")
        return f"sqlite:///{path}", lambda: _file_lock(lock), {"connect_args": {"timeout": _LOCK_TIMEOUT_S}}
    if kind.split("+")[0] not in ("postgresql", "postgres"):
        raise InputError(f"storage {kind}:// is neither a file nor postgresql://USER@HOST:PORT/DATABASE")
    url = f"postgresql+psycopg://{rest}"
    # A connection that the server has dropped is replaced unnoticed before it is used.
    options = {"pool_pre_ping": True, "connect_args": _CONNECTION_OPTIONS}
    engine = sqlalchemy.create_engine(url, pool_size=1, isolation_level="AUTOCOMMIT", **options)
    return url, lambda: _database_lock(engine), options


@contextlib.contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    with path.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _database_lock(engine: sqlalchemy.Engine) -> Iterator[None]:
    key = zlib.crc32(b"laesi_tf sweeps")
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(f"SET lock_timeout = '{_LOCK_TIMEOUT_S}s'"))
        connection.execute(sqlalchemy.text(f"SELECT pg_advisory_lock({key})"))
        try:
            yield
        finally:
            connection.execute(sqlalchemy.text(f"SELECT pg_advisory_unlock({key})"))


def _set_sqlite_pragmas(connection: Any, _: Any) -> None:
    """Readers and a writer beside each other; a kill loses nothing, and no commit waits for the disk."""
    for order in _SQLITE_PRAGMAS:
        connection.execute(order)


def _is_connection_error(error: Exception) -> bool:
    cause = error.__cause__ if isinstance(error, StorageInternalError) else error
    return isinstance(cause, OperationalError | InterfaceError) or (
        isinstance(cause, DBAPIError) and cause.connection_invalidated
    )


def _first_line(error: Exception) -> str:
    cause = error.__cause__ if isinstance(error, StorageInternalError) and error.__cause__ else error
    return str(getattr(cause, "orig", cause)).strip().split("\n")[0]
