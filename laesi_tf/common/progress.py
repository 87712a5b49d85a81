"""A progress bar for loops that take longer than two seconds."""

from collections.abc import Iterable
from typing import Any, TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


def progress_bar(items: Iterable[Item], **options: Any) -> Iterable[Item]:
    """A progress bar on stderr that stays away from anything shorter than two seconds."""
    return tqdm(items, delay=2, dynamic_ncols=True, **options)
