"""What is to be measured: each page of each photo, with the name of its overlay."""

import hashlib
import os
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from laesi_tf.common.progress import progress_bar
from laesi_tf.common.result_files import OVERLAY_SUFFIX
from laesi_tf.data.photo_pages import PhotoPage, list_pages
from laesi_tf.data.photo_search import FoundPhoto
from laesi_tf.measuring.journal import FileState, read_file_state

_MAX_NAME = 50
"""Letters of a photo's name in the name of its overlay: a name has at most 255 bytes, a letter up to four."""
_DIGEST_LETTERS = 8


@dataclass(frozen=True)
class PhotoTask:
    """A photo, or a page of a file, that is to be measured."""

    page: PhotoPage
    key: str
    """Absolute path and number of the page: the same from any working folder."""
    state: FileState | None
    """Of the file when it was listed; None if there was none."""
    overlay: str
    """Name of the overlay's file."""


def make_tasks(
    photos: Sequence[FoundPhoto], taken: Mapping[str, str], *, foreign: Container[str] = ()
) -> list[PhotoTask]:
    """Return the tasks of `photos`, in their order.

    `taken` are the names of the overlays of earlier runs by the key of their photo: a photo keeps its own,
    and gets no name of another. `foreign` are names, in lower case, of files that are none of ours.
    """
    owners = {name.lower(): key for key, name in taken.items()}
    tasks = []
    for photo in progress_bar(photos, desc="listing", unit="file"):
        for page in list_pages(photo.path):
            # Not `resolve`: a link to a photo is a photo of its own.
            key = os.path.abspath(photo.path) + page.ending  # noqa: PTH100
            overlay = taken.get(key) or _name_overlay(photo, page, key, owners, foreign)
            owners[overlay.lower()] = key
            tasks.append(PhotoTask(page, key, read_file_state(photo.path), overlay))
    return tasks


def _name_overlay(
    photo: FoundPhoto, page: PhotoPage, key: str, owners: Mapping[str, str], foreign: Container[str]
) -> str:
    """Return a name that no other photo has, case ignored.

    It is the photo's, with its subfolders before it. Where that is long, or another photo has it, a digest of
    the photo's path makes it unique: the name does not depend on how many others are alike.
    """
    name = photo.inside.replace("/", "-") + photo.path.stem
    ending = "" if page.number is None else f"-page{page.number}"
    if len(name) > _MAX_NAME:
        name = f"{name[:_MAX_NAME]}-{_digest(photo.inside + photo.path.name)}"
    candidates = [name, f"{name}-{photo.path.suffix[1:]}", f"{name}-{_digest(key)}"]
    names = [f"{candidate}{ending}{OVERLAY_SUFFIX}" for candidate in candidates]
    ours = (name for name in names if owners.get(name.lower(), key) == key and name.lower() not in foreign)
    return next(ours, names[-1])


def _digest(text: str) -> str:
    return hashlib.sha256(os.fsencode(text)).hexdigest()[:_DIGEST_LETTERS]
