"""A real PostgreSQL server on loopback, for the tests of storages."""

import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
import pytest


def binaries() -> Path | None:
    """Return the folder of `postgres` and `initdb`, which Debian keeps off the path, or None."""
    debian = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))
    found = shutil.which("postgres") or (debian[-1] if debian else None)
    return Path(found).resolve().parent if found else None


needs_postgres = pytest.mark.skipif(
    binaries() is None, reason="no postgres binary; apt-get install postgresql"
)


class Server:
    """A server with its data in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run_as: list[str] = []
        if os.geteuid() == 0:  # the server refuses to run as root
            shutil.chown(folder, "postgres")
            self._run_as = ["runuser", "-u", "postgres", "--"]
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._run("initdb", "--auth=trust", "--username=laesi", "--no-sync", "--encoding=UTF8", "--locale=C")

    def start(self) -> None:
        """Start the server and wait until it answers."""
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories='' -c fsync=off"
        self._run("pg_ctl", "start", "-w", "-l", str(self.folder / "log"), "-o", options)

    def stop(self) -> None:
        """Stop the server at once, as a crash does: connections break, nothing is shut down in order."""
        self._run("pg_ctl", "stop", "-m", "immediate")

    def create_database(self, name: str) -> str:
        """Create a database and return its URL."""
        with psycopg.connect(f"{self._url}/postgres", autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}"')
        return f"{self._url}/{name}"

    @property
    def _url(self) -> str:
        return f"postgresql://laesi@127.0.0.1:{self.port}"

    def _run(self, program: str, *arguments: str) -> None:
        command = [*self._run_as, f"{binaries()}/{program}", "-D", str(self.folder / "data"), *arguments]
        # A started server keeps the pipes that it is given open, so its output goes to a file.
        with tempfile.TemporaryFile() as output:
            if subprocess.run(command, stdout=output, stderr=output, cwd="/", check=False).returncode:
                output.seek(0)
                raise RuntimeError(output.read().decode())


@contextmanager
def run_server() -> Iterator[Server]:
    """Run a server inside this context."""
    with tempfile.TemporaryDirectory(prefix="laesi-postgres-", dir="/tmp") as folder:
        server = Server(Path(folder))
        server.start()
        try:
            yield server
        finally:
            server.stop()
