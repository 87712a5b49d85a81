"""A real PostgreSQL server on loopback, for the tests of what is kept in one."""

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg


def binaries() -> Path | None:
    """The folder of `postgres` and `initdb`; Debian keeps it off the path."""
    debian = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))
    found = shutil.which("postgres") or (debian[-1] if debian else None)
    return Path(found).resolve().parent if found else None


class Server:
    """A server with its data in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._as = folder, []
        if os.geteuid() == 0:  # the server refuses to run as root
            shutil.chown(folder, "postgres")
            self._as = ["runuser", "-u", "postgres", "--"]
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._run("initdb", "--auth=trust", "--username=laesi", "--no-sync", "--encoding=UTF8", "--locale=C")

    def start(self) -> None:
        """Start it and wait until it answers."""
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories='' -c fsync=off"
        self._run("pg_ctl", "start", "-w", "-l", str(self.folder / "log"), "-o", options)

    def stop(self) -> None:
        """End it at once, as a crash would: connections break, nothing is written in an orderly way."""
        self._run("pg_ctl", "stop", "-m", "immediate")

    def database(self, name: str) -> str:
        """The URL of a new database."""
        with psycopg.connect(f"{self._url}/postgres", autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}"')
        return f"{self._url}/{name}"

    @property
    def _url(self) -> str:
        return f"postgresql://laesi@127.0.0.1:{self.port}"

    def _run(self, program: str, *arguments: str) -> None:
        command = [*self._as, str(binaries() / program), "-D", str(self.folder / "data"), *arguments]
        # A started server keeps the pipes it is given: to a file, or one would wait for them for ever.
        with tempfile.TemporaryFile() as told:
            if subprocess.run(command, stdout=told, stderr=told, cwd="/", check=False).returncode:
                told.seek(0)
                raise RuntimeError(told.read().decode())


@contextmanager
def server() -> Iterator[Server]:
    """A running server, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="laesi-postgres-", dir="/tmp") as folder:
        made = Server(Path(folder))
        made.start()
        try:
            yield made
        finally:
            made.stop()
