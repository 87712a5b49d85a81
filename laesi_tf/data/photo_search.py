"""Find the photos that a user names: files, folders with or without their subfolders, patterns.

What is in a folder and is no photo is counted with the reason, so that the user sees that it was passed over.
"""

import collections
import glob
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.common.result_files import is_result_file
from laesi_tf.data.decoding import require_path
from laesi_tf.data.file_formats import PHOTO_SUFFIXES

_SYSTEM_FILES = frozenset(
    {"thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r", "@eadir", "__macosx", "$recycle.bin"}
)
"""Names that operating systems and storage devices create, in lower case."""
_MAX_SUFFIXES = 6
"""Suffixes that are named one by one; the others are counted together."""


@dataclass(frozen=True)
class FoundPhoto:
    """A photo that was named, or that is in a folder that was named."""

    path: Path
    inside: str = ""
    """Its subfolder relative to the folder that was named, with a slash; "" for a file that was named."""


@dataclass
class PhotoSearch:
    """What was found."""

    photos: list[FoundPhoto] = field(default_factory=list)
    suffixes: "collections.Counter[str]" = field(default_factory=collections.Counter)
    """Number of files that are no photos by their suffix, in lower case; "" for files without one."""
    subfolders: int = 0
    """Subfolders that were not entered, because that was not asked for."""
    repeated: int = 0
    """Folders that links lead to a second time."""
    closed: list[str] = field(default_factory=list)
    """Subfolders that cannot be listed, each with the reason."""

    @property
    def paths(self) -> list[Path]:
        """The photos' files."""
        return [photo.path for photo in self.photos]

    def describe_passed_over(self) -> str:
        """Return what was passed over and why, as one line; "" if nothing was."""
        parts = []
        if count := sum(self.suffixes.values()):
            parts.append(f"{_count(count, 'file')} that {_are(count)} no photo ({self._list_suffixes()})")
        if self.subfolders:
            parts.append(f"{_count(self.subfolders, 'subfolder')} (--recursive measures their photos, too)")
        if self.repeated:
            parts.append(f"{_count(self.repeated, 'link')} to a folder that was searched already")
        if self.closed:
            more = "" if len(self.closed) == 1 else f" and {len(self.closed) - 1} more"
            parts.append(
                f"{_count(len(self.closed), 'folder')} that cannot be listed: {self.closed[0]}{more}"
            )
        return "; ".join(parts)

    def _list_suffixes(self) -> str:
        common = self.suffixes.most_common(_MAX_SUFFIXES)
        parts = [f"{count} {suffix or 'without suffix'}" for suffix, count in common]
        rest = sum(self.suffixes.values()) - sum(count for _, count in common)
        return ", ".join(parts + ([f"{rest} of other kinds"] if rest else []))


def find_photos(arguments: Sequence[str], *, recursive: bool = False) -> PhotoSearch:
    """Find the photos that `arguments` name, each once, in the order of the arguments and of names.

    An argument is a file, a folder, or a pattern such as `photos/*.jpg` that the shell left as it is. A file
    that is named need not exist: it fails to decode. Raises InputError for an empty argument, a URL, a
    pattern that matches nothing and a folder without photos.
    """
    search, seen = PhotoSearch(), set[str]()
    for text in arguments:
        for path in _expand_pattern(text):
            # Unlike Path.is_dir, os.path.isdir raises nothing for a name that is too long.
            is_folder = os.path.isdir(path)  # noqa: PTH112
            found = _search_folder(path, search, recursive=recursive) if is_folder else [FoundPhoto(path)]
            for photo in found:
                # Not `resolve`: a link to a photo is a photo of its own, with its own name.
                key = os.path.abspath(photo.path)  # noqa: PTH100
                if key not in seen:
                    seen.add(key)
                    search.photos.append(photo)
    return search


def _expand_pattern(text: str) -> list[Path]:
    """Return the paths that `text` stands for: itself, or what it matches as a pattern."""
    path = require_path(text)
    if os.path.lexists(path) or not glob.has_magic(text):
        return [path]
    # Unlike Path.glob, it takes absolute patterns.
    matches = sorted(glob.glob(text, recursive=True))  # noqa: PTH207
    if not matches:
        raise InputError(f"no file matches {text}; check the folder and the pattern")
    return [Path(match) for match in matches if not is_result_file(Path(match).name)]


def _search_folder(folder: Path, search: PhotoSearch, *, recursive: bool) -> list[FoundPhoto]:
    """Return the photos in `folder`. Raises InputError if it cannot be listed or has none."""
    try:
        found = list(_walk(folder, search, recursive=recursive))
    except OSError as error:
        raise InputError(f"cannot list {folder}: {error.strerror}; check its permissions") from None
    if not found:
        passed_over = search.describe_passed_over()
        raise InputError(
            f"folder {folder} has no photo in it{f' (passed over: {passed_over})' if passed_over else ''}; "
            "name one with JPEG, HEIC or TIFF files"
        )
    return found


def _walk(top: Path, search: PhotoSearch, *, recursive: bool) -> Iterator[FoundPhoto]:
    """Yield the photos in `top`, then those of each subfolder. Raises OSError if `top` cannot be listed."""
    waiting, visited = [(top, "")], set[tuple[int, int]]()
    while waiting:
        folder, inside = waiting.pop()
        try:
            status = folder.stat()
            if (status.st_dev, status.st_ino) in visited:
                search.repeated += 1
                continue
            visited.add((status.st_dev, status.st_ino))
            with os.scandir(folder) as entries:
                visible = sorted((e for e in entries if not _is_hidden(e.name)), key=lambda entry: entry.name)
        except OSError as error:
            if folder is top:
                raise
            search.closed.append(f"{folder} ({error.strerror})")
            continue
        subfolders = [entry.name for entry in visible if _is_folder(entry)]
        for entry in visible:
            if is_result_file(entry.name) or _is_folder(entry):
                continue
            if Path(entry.name).suffix.lower() in PHOTO_SUFFIXES:
                yield FoundPhoto(folder / entry.name, inside)
            else:
                search.suffixes[Path(entry.name).suffix.lower()] += 1
        if recursive:
            waiting += [(folder / name, f"{inside}{name}/") for name in reversed(subfolders)]
        else:
            search.subfolders += len(subfolders)


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name.lower() in _SYSTEM_FILES


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # A loop of links.
        return False


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _are(number: int) -> str:
    return "is" if number == 1 else "are"
