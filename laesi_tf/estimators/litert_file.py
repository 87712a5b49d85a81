"""Read the files that `laesi export` writes for LiteRT: a graph, and behind it a zip archive with metadata.

TFLite allows an archive at the end of a file and reads the graph alone, so that one file holds both, and
unzip shows what the graph's inputs and outputs mean.
"""

import hashlib
import io
import json
import zipfile
from functools import partial
from pathlib import Path
from threading import BoundedSemaphore
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
    """Runs the signatures of a graph."""

    def __init__(self, model: bytes, *, threads: int = 1, copies: int = 1) -> None:
        """Take a graph, which `threads` cores compute at a time.

        Photos are measured in several threads, and an interpreter has one set of tensors: up to `copies`
        interpreters are made as they are needed, and further callers wait. Raises InputError where LiteRT is
        not installed.
        """
        self._make = partial(_make_interpreter, model, threads)
        self._idle: list[Any] = [self._make()]
        self._free = BoundedSemaphore(copies)

    def __call__(
        self, signature: str | None = None, /, **inputs: NDArray[Any] | np.generic
    ) -> dict[str, NDArray[Any]]:
        """Return the outputs of a `signature` by name; None stands for the only one."""
        with self._free:
            try:
                interpreter = self._idle.pop()
            # All are in use.
            except IndexError:
                interpreter = self._make()
            try:
                outputs: dict[str, NDArray[Any]] = interpreter.get_signature_runner(signature)(**inputs)
                return {name: np.array(value) for name, value in outputs.items()}
            finally:
                self._idle.append(interpreter)

    def release_memory(self) -> None:
        """Drop the interpreters that are not in use; the next call makes a new one.

        An interpreter keeps the memory of the largest input that it has seen.
        """
        self._idle.clear()


def _make_interpreter(model: bytes, threads: int) -> Any:
    try:
        from ai_edge_litert.interpreter import Interpreter
    except ImportError:
        raise InputError("LiteRT is not installed; run pip install ai-edge-litert") from None
    interpreter = Interpreter(model_content=model, num_threads=threads)
    # Here LiteRT writes a line to stderr, which a command that loads a model can hide.
    interpreter.allocate_tensors()
    return interpreter
