"""Where a study is stored: a local SQLite file, or PostgreSQL for many workers and machines.

Both are Optuna's RDBStorage: a transaction is whole or absent even if a worker is killed, and heartbeats show
which workers are alive. (Optuna's journal file has neither: a line cut off by a kill makes all lines after it
unreadable.) Two gaps of RDBStorage are closed here. SQLite does not lock a trial while it is claimed, and
steps that belong together are several transactions. They therefore run under one lock, which the operating
system or the database server releases when its holder dies.
"""

import contextlib
import fcntl
import math
import re
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
from sqlalchemy.exc import ArgumentError, DBAPIError, InterfaceError, OperationalError

from laesi_tf.common.errors import InputError

Result = TypeVar("Result")
Lock = Callable[[], AbstractContextManager[None]]

DEFAULT_STORAGE = "runs/sweep/study.db"
LOCATION_HELP = "a file, or postgresql://USER@HOST:PORT/DATABASE"

# Nobody holds the lock for longer than it takes to write all jobs of a study.
_LOCK_TIMEOUT_S = 60
# A connection whose other end has disappeared breaks within seconds instead of blocking.
_CONNECTION_OPTIONS = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "tcp_user_timeout": 20_000,
    # The server too: it must not keep the lock for a machine that has disappeared.
    "options": "-c tcp_keepalives_idle=10 -c tcp_keepalives_interval=5 -c tcp_keepalives_count=4",
}
# Readers do not block the writer, a kill loses nothing, and no commit waits for the disk.
_SQLITE_PRAGMAS = ("PRAGMA journal_mode=WAL", "PRAGMA synchronous=NORMAL")


MISSED_HEARTBEATS = 6
"""Heartbeats without which a worker counts as dead; tracing a network can cost a live one two of them."""


@dataclass(frozen=True)
class RetryPolicy:
    """How trials that fail and a database that does not answer are handled.

    A job is retried at most `retries` times. A trial is stopped after `time_limit_s` seconds of training, and
    counted as lost when its worker has sent no heartbeat for `grace_s` seconds. A worker waits `patience_s`
    seconds for a database that does not answer. Raises InputError for negative values.
    """

    retries: int = 3
    time_limit_s: float = 300.0
    heartbeat_s: int = 10
    grace_s: int = MISSED_HEARTBEATS * heartbeat_s
    patience_s: float = 300.0

    def __post_init__(self) -> None:
        if self.retries < 0:
            raise InputError(f"--retries is {self.retries}; it must be 0 or more")
        if not 0 < self.time_limit_s < math.inf:
            raise InputError(f"--time-limit is {self.time_limit_s:g} s; it must be above 0 and finite")


class StorageUnreachable(Exception):
    """The database did not answer for as long as the policy allows."""


class StudyStorage:
    """An open storage: Optuna's `rdb`, the lock of all its workers, and retries while it is offline.

    `last_offline_at` is the monotonic time in seconds at which the database last did not answer,
    `last_outage` describes that outage until it is cleared.
    """

    def __init__(self, location: str, policy: RetryPolicy) -> None:
        """Open the storage at `location`, which is created if it is missing. Raises InputError."""
        self.location, self.policy = location, policy
        self.last_outage, self.last_offline_at = "", -math.inf
        url, self._lock, options = _parse_location(location)
        try:
            # Under the lock: two processes that create the tables at once would collide.
            with self._lock(), warnings.catch_warnings():
                warnings.simplefilter("ignore", ExperimentalWarning)
                self.rdb = optuna.storages.RDBStorage(
                    url, options, heartbeat_interval=policy.heartbeat_s, grace_period=policy.grace_s
                )
        except DBAPIError as error:
            raise InputError(
                f"cannot open storage {_hide_password(location)}: {_first_line(error)}"
            ) from error
        if url.startswith("sqlite"):
            sqlalchemy.event.listen(self.rdb.engine, "connect", _set_sqlite_pragmas)
            self.rdb.engine.dispose()

    def lock(self) -> AbstractContextManager[None]:
        """Return a context manager that holds the lock of all workers, for steps that belong together."""
        return self._lock()

    def study_names(self) -> list[str]:
        """Return the names of the studies in this storage, sorted."""
        return sorted(study.study_name for study in self.rdb.get_all_studies())

    def require_study(self, name: str) -> None:
        """Raise InputError, with the names of the studies there are, unless the study `name` exists."""
        names = self.study_names()
        if name not in names:
            raise InputError(f"no study {name} in {self.location}; there are: {', '.join(names) or 'none'}")

    def retry_while_offline(self, function: Callable[[], Result]) -> Result:
        """Return the result of `function`, called again while the database is offline.

        `function` must be repeatable: it may have succeeded already when the connection broke. Raises
        StorageUnreachable.
        """
        offline_since, pause_s = 0.0, 0.1
        while True:
            try:
                return function()
            except (StorageInternalError, DBAPIError) as error:
                if not _is_connection_error(error):
                    raise
                self.last_offline_at = time.monotonic()
                offline_since = offline_since or self.last_offline_at
                offline_s = self.last_offline_at - offline_since
                self.last_outage = f"database offline, for {offline_s:.1f} s so far: {_first_line(error)}"
                if offline_s > self.policy.patience_s:
                    raise StorageUnreachable(self.last_outage) from error
                time.sleep(pause_s)
                pause_s = min(5.0, 2 * pause_s)


def open_existing_storage(location: str, policy: RetryPolicy | None = None) -> StudyStorage:
    """Open a storage that exists already. Raises InputError for a missing file."""
    if "://" not in location and not Path(location).is_file():
        raise InputError(
            f"no storage {location}; name the --storage of a sweep, or start one with sweeps.run"
        )
    return StudyStorage(location, policy or RetryPolicy())


def artifact_folder(location: str) -> Path:
    """Return the folder of a storage's artifacts and checkpoints: the folder of its file."""
    return Path(DEFAULT_STORAGE if "://" in location else location).parent


def require_folder(path: Path) -> None:
    """Raise InputError if `path` exists and is not a folder."""
    if path.exists() and not path.is_dir():
        raise InputError(f"--folder {path} is a file; name a folder")


def quiet_optuna() -> None:
    """Limit Optuna's log to warnings: it writes a line for every trial and study."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)


def _parse_location(location: str) -> tuple[str, Lock, dict[str, Any]]:
    """Return SQLAlchemy's URL, the lock and the engine's options."""
    scheme, separator, rest = location.partition("://")
    if not separator:
        return _open_file(location)
    dialect = scheme.split("+")[0]
    if dialect == "sqlite":
        raise InputError(
            f"--storage {location}: name the file itself, --storage {rest.lstrip('/') or 'FILE'}"
        )
    if dialect not in ("postgresql", "postgres"):
        raise InputError(f"--storage {scheme}:// is not supported; name {LOCATION_HELP}")
    url = f"postgresql+psycopg://{rest}"
    # Connections that the server has dropped are replaced before use.
    options = {"pool_pre_ping": True, "connect_args": _CONNECTION_OPTIONS}
    try:
        engine = sqlalchemy.create_engine(url, pool_size=1, isolation_level="AUTOCOMMIT", **options)
    except (ValueError, ArgumentError) as error:
        raise InputError(
            f"--storage {_hide_password(location)} is not a valid address ({error}); "
            "write postgresql://USER@HOST:PORT/DATABASE with a number as PORT"
        ) from error
    return url, lambda: _database_lock(engine), options


def _open_file(location: str) -> tuple[str, Lock, dict[str, Any]]:
    path = Path(location).absolute()
    if path.is_dir():
        raise InputError(f"--storage {location} is a folder; name a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot create the folder of storage {location}: {error.strerror}") from error
    lock = path.with_name(path.name + ".lock")
    return f"sqlite:///{path}", lambda: _file_lock(lock), {"connect_args": {"timeout": _LOCK_TIMEOUT_S}}


@contextlib.contextmanager
def _file_lock(path: Path) -> Iterator[None]:
    try:
        file = path.open("a")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another --storage") from error
    with file:
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
    for pragma in _SQLITE_PRAGMAS:
        connection.execute(pragma)


def _is_connection_error(error: Exception) -> bool:
    cause = error.__cause__ if isinstance(error, StorageInternalError) else error
    return isinstance(cause, OperationalError | InterfaceError) or (
        isinstance(cause, DBAPIError) and cause.connection_invalidated
    )


def _first_line(error: Exception) -> str:
    cause = error.__cause__ if isinstance(error, StorageInternalError) and error.__cause__ else error
    return str(getattr(cause, "orig", cause)).strip().split("\n")[0]


def _hide_password(location: str) -> str:
    return re.sub(r"(://[^/:@]*):[^/@]*@", r"\1:***@", location)
