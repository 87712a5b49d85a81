"""Text of the table: its columns, cells and notes, as Markdown, CSV and records."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

# isort: split
from experiments.experiment_specs import METRICS, shorten
from experiments.results import SeedStatistics, TableRow, select_shown_rows

CAPTION = "The photographs are not the paper's, which are private."
_TITLES = {
    "val_mre": "Validation MRE (%)",
    "test_mre": "Test MRE (%)",
    "miou": "mIoU",
    "mpe": "Mask pixel error",
}
_DIGITS = {"val_mre": (1, 1), "test_mre": (1, 1), "miou": (3, 2), "mpe": (3, 2)}
"""Of ours and of the paper's."""

Settings = Mapping[str, Any]


def table_header() -> list[str]:
    """The table's columns: each of the paper's figures twice, ours and the paper's."""
    pairs = [name for figure in METRICS for name in (_TITLES[figure], "paper")]
    return ["Experiment", "Real", "Synthetic", *pairs, "Seeds"]


def format_cells(line: TableRow, settings: Settings) -> list[str]:
    """The cells of one row, in the columns of `header`."""
    pictures = ["–" if count is None else str(count) for count in _count_training_pictures(line, settings)]
    pairs = []
    for name, (ours, papers) in _DIGITS.items():
        published = line.paper.get(name)
        pairs.append(_format_cell(line.ours[name], ours) if name in line.planned else "–")
        pairs.append("–" if published is None else f"{published:.{papers}f}")
    return [line.row.title, *pictures, *pairs, str(line.seeds)]


def describe_setup(settings: Settings, caption: str) -> list[str]:
    """What a reader must know before the table."""
    counts = "{train} for training, {val} for validation, {test} for the test".format_map(settings["photos"])
    said = [f"{caption} Photographs: {counts}."]
    if settings["scale"] != 1.0:
        short = f"SHORTENED to a scale of {settings['scale']:g}: fewer pictures and steps, smaller input."
        said.insert(0, f"{short} These figures say nothing about the experiments.")
    return said


def write_notes(lines: Sequence[TableRow]) -> Iterator[str]:
    """What a reader must know to understand the table."""
    yield (
        "Ours: mean ± standard deviation over seeds; mIoU and mask pixel error are fractions, on the test "
        "photographs. Paper: Kałużny et al. (2024), table 1, with 1,700 real photographs, 250 for "
        "validation and 250 for the test; its figures for 10,000 pictures are from its text."
    )
    rules = [line for line in lines if line.row.kind == "rule_based" and line.seeds]
    for line in rules:
        # The same scenes stand in both columns.
        yield (
            f"{line.row.title}: on rendered scenes with red squares, {line.count} for each seed in the whole "
            f"experiment, since ordinary photographs have none; {line.refused // 2} of all were refused and "
            "are not in the means."
        )
    for line in lines:
        if line.refused and line not in rules:
            yield f"{line.row.title}, {line.count}: {line.refused} photographs refused, not in the means."
    if origins := sorted(set().union(*(line.origins for line in lines))):
        yield f"Networks: MobileNetV3, weights from {' and '.join(origins)}."
    if any(not line.seeds for line in select_shown_rows(lines)):
        yield "missing: not run yet, or its data is not there."


def to_markdown(
    lines: Sequence[TableRow], settings: Settings, above: Sequence[str], below: Sequence[str]
) -> str:
    """The table as Markdown between what is said `above` and `below` it."""
    rows = [
        table_header(),
        ["---", *["---:"] * (len(table_header()) - 1)],
        *(format_cells(line, settings) for line in lines),
    ]
    table = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([*(f"**{text}**\n" for text in above), *table, "", *(f"- {text}" for text in below), ""])


def _format_cell(cell: SeedStatistics, digits: int) -> str:
    if cell.mean is None:
        return "missing"
    if cell.deviation is None:
        return f"{cell.mean:.{digits}f}"
    return f"{cell.mean:.{digits}f} ± {cell.deviation:.{digits}f}"


def _count_training_pictures(line: TableRow, settings: Settings) -> tuple[int | None, int | None]:
    """Real and synthetic pictures that the row's networks are trained on; None where it has no network."""
    if line.row.kind == "rule_based":
        return None, None
    return settings["photos"]["train"], shorten(line.count, settings["scale"])


def make_records(lines: Sequence[TableRow], settings: Settings) -> list[dict[str, Any]]:
    """The table's numbers, one dict for each row; None where there is none."""
    records = []
    for line in lines:
        real, synthetic = _count_training_pictures(line, settings)
        record: dict[str, Any] = {
            "experiment": line.row.name,
            "real": real,
            "synthetic": synthetic,
            "seeds": line.seeds,
        }
        for name in METRICS:
            record[name] = line.ours[name].mean
            record[f"{name}_sd"] = line.ours[name].deviation
            record[f"{name}_paper"] = line.paper.get(name)
        records.append(record | {"scale": settings["scale"]})
    return records


def make_csv(lines: Sequence[TableRow], settings: Settings) -> tuple[list[str], list[list[Any]]]:
    records = make_records(lines, settings)
    return list(records[0]), [list(record.values()) for record in records]
