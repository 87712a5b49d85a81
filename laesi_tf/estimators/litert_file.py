"""Read the files that `laesi export` writes for LiteRT: a graph, and behind it a zip archive with metadata.

TFLite allows an archive at the end of a file and reads the graph alone, so that one file holds both, and
unzip shows what the graph's inputs and outputs mean.
"""

import hashlib
import io
import json
import zipfile
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.common.errors import InputError

METADATA_FILE = "laesi.json"
"""The archive's only member."""


class LiteRtFile(NamedTuple):
    """A graph and what it says about itself."""

    model: bytes
    metadata: dict[str, Any]
    """`kind` is photo or area; see `exporting.litert` for the other keys."""


def write_litert_file(path: Path, model: bytes, metadata: dict[str, Any]) -> None:
    """Write a graph with its metadata. Raises InputError where the file cannot be written."""
    archive = io.BytesIO()
    described = metadata | {"sha256": hashlib.sha256(model).hexdigest()}
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as members:
        # A fixed date, so that the same graph gives the same bytes.
        member = zipfile.ZipInfo(METADATA_FILE, (1980, 1, 1, 0, 0, 0))
        members.writestr(member, json.dumps(described, indent=2, ensure_ascii=False))
    with atomic_write(path) as temporary:
        temporary.write_bytes(model + archive.getvalue())


def read_litert_file(path: Path) -> LiteRtFile:
    """Read a graph with its metadata. Raises InputError for a file that is missing, broken or not ours."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as members:
            start = min(member.header_offset for member in members.infolist())
            metadata = json.loads(members.read(METADATA_FILE))
        model, expected = content[:start], metadata["sha256"]
    except (zipfile.BadZipFile, KeyError, ValueError, TypeError, EOFError):
        raise InputError(
            f"{path} has no metadata of laesi_tf: it is cut off or was made elsewhere; write it again with "
            "laesi export"
        ) from None
    if hashlib.sha256(model).hexdigest() != expected:
        raise InputError(f"{path} is damaged: its graph does not match its checksum; write it again")
    return LiteRtFile(model, metadata)


class LiteRtRunner:
    """Runs the one signature of a graph."""

    def __init__(self, model: bytes, *, threads: int = 1) -> None:
        """Take a graph. Raises InputError where the interpreter is not installed."""
        try:
            from ai_edge_litert.interpreter import Interpreter
        except ImportError:
            raise InputError("LiteRT is not installed; run pip install ai-edge-litert") from None
        self._interpreter = Interpreter(model_content=model, num_threads=threads)
        self._interpreter.allocate_tensors()
        (name,) = self._interpreter.get_signature_list()
        self._run = self._interpreter.get_signature_runner(name)
        # Photos are measured in several threads; an interpreter has one set of tensors.
        self._lock = Lock()

    def __call__(self, **inputs: NDArray[Any] | np.generic) -> dict[str, NDArray[Any]]:
        """Return the outputs by name."""
        with self._lock:
            outputs: dict[str, NDArray[Any]] = self._run(**inputs)
            return {name: np.array(value) for name, value in outputs.items()}
