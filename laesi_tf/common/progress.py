"""A progress bar for loops that take longer than two seconds."""

from collections.abc import Iterable
from typing import Any, TypeVar

from tqdm import tqdm

T = TypeVar("T")


def progress_bar(items: Iterable[T], **options: Any) -> "tqdm[T]":
    """Return a progress bar over `items` on stderr, shown after two seconds; `options` are those of tqdm."""
    return tqdm(items, delay=2, dynamic_ncols=True, **options)
