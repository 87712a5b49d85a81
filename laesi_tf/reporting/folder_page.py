"""The summary page of a folder: one self-contained HTML file, which opens without a server."""

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import atomic_write
from laesi_tf.estimators.base import sum_uncertainties
from laesi_tf.reporting.histogram import draw_histogram
from laesi_tf.reporting.html_page import begin_page, escape, show_jpeg
from laesi_tf.reporting.leaf_records import LeafRecord

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #223; background: #fff; max-width: 76rem;
  margin: 2rem auto; padding: 0 1rem }
h1 { font-weight: 600; margin-bottom: 0 } h2 { margin-top: 2.5rem; font-weight: 600 }
.counts { display: flex; flex-wrap: wrap; gap: .5rem 2.5rem; margin: 1.5rem 0; padding: 0; list-style: none }
.counts b { display: block; font-size: 1.6rem; font-weight: 600; font-variant-numeric: tabular-nums }
table { border-collapse: collapse }
td, th { padding: .2rem 1.5rem .2rem 0; vertical-align: top; text-align: left }
td { overflow-wrap: anywhere }
.photos { display: grid; grid-template-columns: repeat(auto-fill, minmax(11rem, 1fr)); gap: 1.25rem 1rem }
figure { margin: 0; content-visibility: auto; contain-intrinsic-size: 11rem 15rem }
figure img, .empty { width: 100%; height: 9rem; object-fit: contain; background: #f2f3f5; display: block }
.empty { color: #566; font-size: .85rem; text-align: center; line-height: 9rem }
figcaption { font-size: .85rem; overflow-wrap: anywhere } figcaption b { font-weight: 600 }
.warn { color: #8a4b00 } .bad { color: #a11b1b } .dim, p.note { color: #566 }
svg { max-width: 100%; height: auto }
"""


@dataclass(frozen=True)
class PagePhoto:
    """A photo on the page."""

    records: Sequence[LeafRecord]
    thumbnail: str | None
    """JPEG in base64."""


def write_page(
    path: Path, photos: Iterable[PagePhoto], *, title: str, facts: Mapping[str, str], passed_over: str
) -> None:
    """Write the page. `photos` are read once, one at a time; `facts` are settings by their name.

    Raises InputError where it cannot be written.
    """
    areas: list[float] = []
    refused: list[tuple[str, str]] = []
    counts = {"photos": 0, "leaves": 0, "photos without an area": 0, "photos with a note": 0}
    # The counts come first on the page and are known last, so that photos are formatted into a file of their
    # own: thumbnails of thousands of photos do not fit into memory.
    options: dict[str, Any] = {"encoding": "utf-8", "errors": "replace"}
    with (
        atomic_write(path) as temporary,
        tempfile.TemporaryFile("w+", dir=path.parent, **options) as cards,
        temporary.open("w", **options) as page,
    ):
        for photo in photos:
            first = photo.records[0]
            found = [record.area_cm2 for record in photo.records if record.area_cm2 is not None]
            areas += found
            counts["photos"] += 1
            counts["leaves"] += len(found)
            counts["photos without an area"] += first.error is not None
            counts["photos with a note"] += any(record.note for record in photo.records)
            if first.error is not None:
                refused.append((_name(first), first.error))
            cards.write(_format_card(photo))
        page.writelines(_format_head(title, facts, counts, areas, passed_over))
        page.writelines(_format_refused(refused))
        page.write('<h2>Photos</h2>\n<div class="photos">\n')
        cards.seek(0)
        page.writelines(cards)
        page.write("</div>\n</body></html>\n")


def _format_head(
    title: str, facts: Mapping[str, str], counts: Mapping[str, int], areas: Sequence[float], passed_over: str
) -> Iterator[str]:
    yield begin_page(title, _STYLE)
    numbers = {name: f"{count:,}" for name, count in counts.items()}
    if areas:
        numbers["cm² in total"] = f"{sum(areas):,.1f}"
        numbers["cm², median leaf"] = f"{sorted(areas)[len(areas) // 2]:.4g}"
    items = "".join(f"<li><b>{value}</b>{escape(name)}</li>" for name, value in numbers.items())
    yield f'<ul class="counts">{items}</ul>\n'
    if len(areas) > 1:
        yield f"<h2>Areas</h2>\n{draw_histogram(areas)}\n"
    yield "<h2>How it was measured</h2>\n<table>"
    yield from (f"<tr><td>{escape(name)}</td><td>{escape(fact)}</td></tr>" for name, fact in facts.items())
    yield "</table>\n"
    if passed_over:
        yield f'<p class="note">Passed over: {escape(passed_over)}.</p>\n'


def _format_refused(refused: Sequence[tuple[str, str]]) -> Iterator[str]:
    if refused:
        yield "<h2>Photos without an area</h2>\n<table><tr><th>photo</th><th>reason</th></tr>\n"
        yield from (f"<tr><td>{escape(name)}</td><td>{escape(why)}</td></tr>\n" for name, why in refused)
        yield "</table>\n"


def _format_card(photo: PagePhoto) -> str:
    """Return a photo's thumbnail with its area, its notes or the reason why there is no area."""
    first = photo.records[0]
    image = show_jpeg(photo.thumbnail) if photo.thumbnail else '<div class="empty">not measured</div>'
    if first.error is not None:
        result = '<span class="bad">no area</span>'
    else:
        area = sum(record.area_cm2 or 0.0 for record in photo.records)
        sd = sum_uncertainties([record.uncertainty_cm2 for record in photo.records])
        result = f"<b>{area:.2f}{'' if sd is None else f' ± {sd:.2f}'} cm²</b>"
        result += f", {len(photo.records)} leaves" if len(photo.records) > 1 else ""
    notes = dict.fromkeys(record.note for record in photo.records if record.note)
    warnings = "".join(f'<br><span class="warn">{escape(note)}</span>' for note in list(notes)[:2])
    caption = f'{result}<br><span class="dim">{escape(_name(first))}</span>{warnings}'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>\n"


def _name(record: LeafRecord) -> str:
    return record.photo if record.sample is None else f"{record.sample} ({record.photo})"
