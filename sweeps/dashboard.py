"""Show studies in a browser: optuna-dashboard on the storage of a sweep, with its artifacts.

It listens on this machine alone unless --host names another address: whoever reaches the dashboard can change
and delete studies.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

import optuna
from optuna.artifacts import FileSystemArtifactStore

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError
from sweeps.queue import optuna_adapter
from sweeps.queue.study_storage import (
    DEFAULT_STORAGE,
    LOCATION_HELP,
    artifact_folder,
    open_existing_storage,
    quiet_optuna,
    require_folder,
)


def main(arguments: Sequence[str]) -> None:
    """Serve the dashboard until Ctrl-C."""
    options = _make_parser().parse_args(arguments)
    quiet_optuna()
    server = make_dashboard_server(options.storage, options.folder, host=options.host, port=options.port)
    address = f"http://{options.host}:{server.server_port}/dashboard"
    if options.json:
        write_json(options.json, {"address": address})
    print(f"{address} (Ctrl-C stops it)", flush=True)
    server.serve_forever()


def make_dashboard_server(storage: str, folder: Path | None, *, host: str, port: int) -> WSGIServer:
    """Return a listening server of the dashboard; port 0 takes a free one. Raises InputError."""
    import optuna_dashboard

    folder = folder or artifact_folder(storage)
    require_folder(folder)
    # Through Optuna's cache: finished trials are read once, not for every page.
    cached = optuna.storages.get_storage(open_existing_storage(storage).rdb)
    for study in cached.get_all_studies():
        cached.get_all_trials(optuna_adapter.study_id(cached, study.study_name), deepcopy=False)
    artifacts = folder / "artifacts"
    artifacts.mkdir(parents=True, exist_ok=True)
    app = optuna_dashboard.wsgi(cached, artifact_store=FileSystemArtifactStore(artifacts))
    try:
        return make_server(host, port, app, server_class=_ThreadedServer, handler_class=_QuietHandler)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot listen on {host}:{port}: {reason}; choose another --port") from error


class _ThreadedServer(ThreadingMixIn, WSGIServer):
    """Answers the several requests of a page at once."""

    daemon_threads = True


class _QuietHandler(WSGIRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Log nothing for each request."""


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("dashboard", __doc__, package="sweeps")
    parser.add_argument("--storage", default=DEFAULT_STORAGE, help=LOCATION_HELP)
    parser.add_argument(
        "--folder", type=Path, help="--folder of sweeps.run (default: that of the storage's file)"
    )
    parser.add_argument("--port", type=int, default=8080, help="port to listen on")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    return parser


if __name__ == "__main__":
    run_command(main)
