"""Write the page as a folder of static files, which any web server can show."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import write_bytes, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.exporting.web import litert_js

_ASSETS = Path(__file__).parent / "assets"
_WORKER = "service_worker.js"
_FIRST_WORDS = "const VERSION ="
"""Of the worker that is written."""
_CACHED_ON_USE = ".wasm", "_internal.js"
"""Ends of names: a browser uses one of the variants of WebAssembly."""


def find_runtime() -> list[Path]:
    """Return the files of LiteRT.js. Raises InputError where they are missing."""
    files = litert_js.list_files()
    if not files:
        raise InputError(
            "LiteRT.js is missing, which runs the measurement in a browser; run laesi web --fetch-runtime on "
            "a machine with npm and a network"
        )
    return files


def fetch_runtime() -> None:
    """Fetch LiteRT.js with npm into the package. Raises InputError."""
    try:
        litert_js.fetch()
    except litert_js.FetchError as error:
        raise InputError(f"cannot fetch LiteRT.js: {error}") from None


def require_own_folder(out: Path) -> None:
    """Raise InputError if `out` holds anything that this module has not written."""
    try:
        is_ours = (out / _WORKER).read_text(encoding="utf-8").startswith(_FIRST_WORDS)
        is_empty = not any(out.iterdir())
    except (OSError, UnicodeDecodeError):
        is_ours, is_empty = False, not out.exists()
    if not (is_ours or is_empty):
        raise InputError(f"{out} holds other files, which might be replaced; choose another --out")


def write_site(
    out: Path, *, models: Mapping[str, bytes], documents: Mapping[str, bytes], sentences: Mapping[str, Any]
) -> int:
    """Write the page to the folder `out` and return its size in bytes.

    `models` are exported files by name, `documents` the sheets to print, `sentences` what the page shows.
    Raises InputError where LiteRT.js is missing or a file cannot be written.
    """
    contents = {path.name: path.read_bytes() for path in sorted(_ASSETS.iterdir()) if path.is_file()}
    contents |= {f"runtime/{path.name}": path.read_bytes() for path in find_runtime()}
    contents |= dict(models) | dict(documents)
    contents["sentences.json"] = json.dumps(sentences, ensure_ascii=False, indent=1).encode()
    worker = contents.pop(_WORKER).decode()
    for name, content in contents.items():
        write_bytes(out / name, content)
    # Last, so that browsers take the new version only when all of it is there.
    write_text(out / _WORKER, _name_files(worker, contents))
    return sum(map(len, contents.values()))


def _name_files(worker: str, contents: Mapping[str, bytes]) -> str:
    """Return the service worker with the names of what it keeps, and a version that changes with it."""
    digest = hashlib.sha256()
    for name, content in sorted(contents.items()):
        digest.update(name.encode() + hashlib.sha256(content).digest())
    kept = [name for name in contents if not name.endswith(_CACHED_ON_USE)]
    head = f"{_FIRST_WORDS} {json.dumps(digest.hexdigest()[:16])};\nconst FILES = {json.dumps(kept)};\n"
    return head + worker
