"""The printed summary of measured photos: each photo where they are few, else what needs attention."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from laesi_tf.common.text import sanitise_text
from laesi_tf.estimators.base import sum_uncertainties
from laesi_tf.measuring.journal import JournalEntry
from laesi_tf.reporting.leaf_records import LeafRecord

_MAX_PHOTOS = 40
"""More photos are not listed one by one."""
_MAX_REASONS = 10
_MAX_EXAMPLES = 3


class SummaryLine(NamedTuple):
    """A line of the list of photos."""

    name: str
    result: str
    is_leaf: bool = False


@dataclass
class Summary:
    """Counts, and the reasons why photos have no area."""

    photos: int = 0
    leaves: int = 0
    refused: int = 0
    unreadable: int = 0
    first_error: str = ""
    lines: list[SummaryLine] = field(default_factory=list)
    """One for each of the first photos, and for each leaf where a photo has several."""
    reasons: dict[str, tuple[str, int, list[str]]] = field(default_factory=dict)
    """An example, the number of photos and the first of them, by the reason without numbers and paths."""


def summarise(entries: Iterable[JournalEntry]) -> Summary:
    """Summarise `entries`, of which only a few are kept in memory."""
    summary = Summary()
    for entry in entries:
        records = entry.records
        summary.photos += 1
        summary.leaves += sum(record.area_cm2 is not None for record in records)
        summary.refused += records[0].refused
        if records[0].is_unreadable:
            summary.unreadable += 1
            summary.first_error = summary.first_error or records[0].error or ""
        if records[0].error is not None:
            _add_reason(summary, records[0])
        if summary.photos <= _MAX_PHOTOS:
            summary.lines += _list_leaves(records)
    return summary


def format_summary(summary: Summary, *, table: object) -> list[str]:
    """Return the lines to print."""
    if summary.photos <= _MAX_PHOTOS:
        width = max((len(line.name) for line in summary.lines), default=0)
        lines = [
            f"{line.name.rjust(width) if line.is_leaf else line.name.ljust(width)}  {line.result}"
            for line in summary.lines
        ]
    else:
        lines = list(_list_reasons(summary))
    lines.append(
        f"leaves measured: {summary.leaves}, photos refused: {summary.refused}, skipped: "
        f"{summary.unreadable}; see {sanitise_text(table)}"
    )
    return lines


def _add_reason(summary: Summary, record: LeafRecord) -> None:
    reason = (record.error or "").replace(record.photo.partition("#")[0], "").strip()
    kind = re.sub(r"\d+", "#", reason)
    example, count, photos = summary.reasons.get(kind, (reason, 0, []))
    summary.reasons[kind] = (example, count + 1, [*photos, record.photo][:_MAX_EXAMPLES])


def _list_reasons(summary: Summary) -> Iterator[str]:
    """Yield a line for each reason, the most frequent first."""
    reasons = sorted(summary.reasons.values(), key=lambda reason: -reason[1])
    for example, count, photos in reasons[:_MAX_REASONS]:
        more = f" and {count - len(photos)} more" if count > len(photos) else ""
        yield f"{count} without an area: {sanitise_text(example)}: {sanitise_text(', '.join(photos))}{more}"
    if rest := sum(count for _, count, _ in reasons[_MAX_REASONS:]):
        yield f"{rest} without an area for other reasons: see the column error"


def _list_leaves(records: tuple[LeafRecord, ...]) -> Iterator[SummaryLine]:
    yield SummaryLine(sanitise_text(records[0].photo), _format_records(records))
    if len(records) > 1:
        for record in records:
            yield SummaryLine(f"leaf {record.leaf}", _format_records((record,)), is_leaf=True)


def _format_records(records: tuple[LeafRecord, ...]) -> str:
    """Return the total area of `records` as text, or why there is none."""
    if records[0].area_cm2 is None:
        return sanitise_text(records[0].error)
    text = f"{sum(record.area_cm2 or 0.0 for record in records):9.2f} cm2"
    uncertainty = sum_uncertainties([record.uncertainty_cm2 for record in records])
    text += "" if uncertainty is None else f" ± {uncertainty:.2f}"
    if len(records) > 1:
        return f"{text}, {len(records)} leaves"
    return text if records[0].note is None else f"{text}  ({records[0].note})"
