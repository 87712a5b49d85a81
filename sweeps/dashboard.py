"""Watch studies in a browser: optuna-dashboard on the storage of a sweep, its artifacts included.

It listens on this machine alone unless --host says otherwise: the dashboard lets anyone who reaches it
change and delete studies.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError

# isort: split
import optuna
import optuna_dashboard
from optuna.artifacts import FileSystemArtifactStore

from sweeps.queue.study_storage import DEFAULT_STORAGE, RetryPolicy, StudyStorage, artifact_folder


def main(arguments: Sequence[str]) -> None:
    """Serve the dashboard until Ctrl-C."""
    options = _make_parser().parse_args(arguments)
    if options.json:
        require_writable(options.json)
    server = make_dashboard_server(options.storage, options.folder, host=options.host, port=options.port)
    address = f"http://{options.host}:{server.server_port}/dashboard"
    if options.json:
        write_json(options.json, {"address": address})
    print(f"{address} (Ctrl-C ends it)", flush=True)
    server.serve_forever()


def make_dashboard_server(storage: str, folder: Path | None, *, host: str, port: int) -> WSGIServer:
    """A server of the dashboard, listening; port 0 takes a free one. Raises InputError where it cannot."""
    if "://" not in storage and not Path(storage).is_file():
        raise InputError(f"no storage {storage}: let sweeps.run begin a study first, or name its --storage")
    # With Optuna's cache: what has ended is read once, not for every look at the page.
    cached = optuna.storages.get_storage(StudyStorage(storage, RetryPolicy()).storage)
    for study in cached.get_all_studies():
        cached.get_all_trials(study._study_id, deepcopy=False)
    artifacts = (folder or artifact_folder(storage)) / "artifacts"
    artifacts.mkdir(parents=True, exist_ok=True)
    app = optuna_dashboard.wsgi(cached, artifact_store=FileSystemArtifactStore(artifacts))
    try:
        return make_server(host, port, app, server_class=_ThreadedServer, handler_class=_QuietHandler)
    except OSError as error:
        told = f"cannot listen on {host}:{port}: {error.strerror}; choose another --port"
        raise InputError(told) from error


class _ThreadedServer(ThreadingMixIn, WSGIServer):
    """A page asks for several things at once."""

    daemon_threads = True


class _QuietHandler(WSGIRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Say nothing of each request."""


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("watch", __doc__, package="sweeps")
    made.add_argument(
        "--storage", default=DEFAULT_STORAGE, help="a file, or postgresql://USER@HOST:PORT/DATABASE"
    )
    made.add_argument("--folder", type=Path, help="that of the sweep's artifacts (default: beside the file)")
    made.add_argument("--port", type=int, default=8080, help="port to listen on")
    made.add_argument("--host", default="127.0.0.1", help="address to listen on")
    return made


if __name__ == "__main__":
    run_command(main)
