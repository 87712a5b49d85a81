"""Text of the table: its columns, cells and notes, as Markdown, CSV and records."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from experiments.experiment_specs import METRICS, shorten
from experiments.results import SeedStatistics, TableRow, select_shown_rows
from laesi_tf.reporting.markdown import format_table

CAPTION = "The photographs are not the paper's, which are private."
_TITLES = {
    "val_mre": "Validation MRE (%)",
    "test_mre": "Test MRE (%)",
    "miou": "mIoU",
    "mpe": "Mask pixel error",
}
_DIGITS = {"val_mre": (1, 1), "test_mre": (1, 1), "miou": (3, 2), "mpe": (3, 2)}
"""Decimals of our and of the paper's metrics."""
_NOT_RUN, _ALL_REFUSED, _NOT_PLANNED = "missing", "refused", "–"

Settings = Mapping[str, Any]


def table_header() -> list[str]:
    """Return the table's columns: each metric twice, ours and the paper's."""
    pairs = [title for name in METRICS for title in (_TITLES[name], "paper")]
    return ["Experiment", "Real", "Synthetic", *pairs, "Seeds"]


def format_cells(row: TableRow, settings: Settings) -> list[str]:
    """Return the cells of one row, in the columns of `table_header`."""
    counts = [
        _NOT_PLANNED if count is None else str(count) for count in _count_training_images(row, settings)
    ]
    pairs = []
    for name, (our_digits, paper_digits) in _DIGITS.items():
        published = row.paper.get(name)
        pairs.append(
            _format_cell(row.ours[name], our_digits) if name in row.planned_metrics else _NOT_PLANNED
        )
        pairs.append(_NOT_PLANNED if published is None else f"{published:.{paper_digits}f}")
    return [row.experiment.title, *counts, *pairs, str(row.seeds)]


def describe_setup(settings: Settings, caption: str) -> list[str]:
    """Return the paragraphs above the table: the photos, and whether the experiments were shortened."""
    counts = "{train} for training, {val} for validation, {test} for the test".format_map(settings["photos"])
    paragraphs = [f"{caption} Photographs: {counts}."]
    if settings["scale"] != 1.0:
        shortened = f"SHORTENED to a scale of {settings['scale']:g}: fewer images and steps, smaller input."
        paragraphs.insert(0, f"{shortened} These results say nothing about the experiments.")
    return paragraphs


def write_notes(rows: Sequence[TableRow]) -> Iterator[str]:
    """Yield the notes below the table."""
    yield (
        "Ours: mean ± standard deviation over seeds; mIoU and mask pixel error are fractions, on the test "
        "photographs. Paper: Kałużny et al. (2024), table 1, with 1,700 real photographs, 250 for "
        "validation and 250 for the test; its results for 10,000 images are from its text."
    )
    by_rules = [row for row in rows if row.experiment.data_type == "rule_based" and row.seeds]
    for row in by_rules:
        # Both columns show the same scenes.
        yield (
            f"{row.experiment.title}: on rendered scenes with red squares, {row.count} for each seed in the "
            f"full experiment, as ordinary photographs have none; {row.refused // 2} of all were refused and "
            "are not in the means."
        )
    for row in rows:
        if row.refused and row not in by_rules:
            yield (
                f"{row.experiment.title}, {row.count}: {row.refused} photographs refused, not in the means."
            )
    if origins := sorted(set().union(*(row.origins for row in rows))):
        yield f"Networks: MobileNetV3, weights from {' and '.join(origins)}."
    cells = [
        _format_cell(row.ours[name], 1) for row in select_shown_rows(rows) for name in row.planned_metrics
    ]
    if _ALL_REFUSED in cells:
        yield f"{_ALL_REFUSED}: measured, but every photograph was refused."
    if _NOT_RUN in cells:
        yield f"{_NOT_RUN}: not run yet, or its data does not exist."


def to_markdown(
    rows: Sequence[TableRow], settings: Settings, above: Sequence[str], below: Sequence[str]
) -> str:
    """Return the table as Markdown between the paragraphs `above` and the notes `below`."""
    table = format_table(table_header(), [format_cells(row, settings) for row in rows], align_right=True)
    return "\n".join([*(f"**{text}**\n" for text in above), *table, "", *(f"- {text}" for text in below), ""])


def make_records(rows: Sequence[TableRow], settings: Settings) -> list[dict[str, Any]]:
    """Return the table's numbers, one dict for each row; None for a missing one."""
    records = []
    for row in rows:
        real, synthetic = _count_training_images(row, settings)
        record: dict[str, Any] = {
            "experiment": row.experiment.name,
            "real": real,
            "synthetic": synthetic,
            "seeds": row.seeds,
        }
        for name in METRICS:
            record[name] = row.ours[name].mean
            record[f"{name}_sd"] = row.ours[name].deviation
            record[f"{name}_paper"] = row.paper.get(name)
        records.append(record | {"scale": settings["scale"]})
    return records


def make_csv(rows: Sequence[TableRow], settings: Settings) -> tuple[list[str], list[list[Any]]]:
    """Return the header and the rows of the CSV file."""
    records = make_records(rows, settings)
    return list(records[0]), [list(record.values()) for record in records]


def _format_cell(metric: SeedStatistics, digits: int) -> str:
    if metric.mean is None:
        return _ALL_REFUSED if metric.jobs else _NOT_RUN
    if metric.deviation is None:
        return f"{metric.mean:.{digits}f}"
    return f"{metric.mean:.{digits}f} ± {metric.deviation:.{digits}f}"


def _count_training_images(row: TableRow, settings: Settings) -> tuple[int | None, int | None]:
    """Return how many real and synthetic images its networks are trained on; None without a network."""
    if row.experiment.data_type == "rule_based":
        return None, None
    return settings["photos"]["train"], shorten(row.count, settings["scale"])
