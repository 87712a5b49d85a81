"""The paper's table with our figures beside the paper's, and the error against the data's size.

Writes table.md, table.csv, table.png and sizes.png. What has not been run is shown as missing.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli import parser, run

# isort: split
from experiments import drawing
from experiments.results import Cell, Line, collect, read_settings, shown
from experiments.rows import FIGURES, load_rows, scaled
from experiments.run import OUT
from laesi_tf.files import require_writable, write_csv, write_figure, write_json, write_text

CAPTION = "The photographs are not the paper's, which are private."
_HEADS = {
    "val_mre": "Validation MRE (%)",
    "test_mre": "Test MRE (%)",
    "miou": "mIoU",
    "mpe": "Mask pixel error",
}
_DIGITS = {"val_mre": (1, 1), "test_mre": (1, 1), "miou": (3, 2), "mpe": (3, 2)}
"""Of ours and of the paper's."""
_FILES = ("table.md", "table.csv", "table.png", "sizes.png")

Settings = Mapping[str, Any]


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError where there are no experiments or a file cannot be written."""
    options = _parser().parse_args(arguments)
    out = options.out or options.runs
    settings, lines = read_settings(options.runs), collect(options.runs, load_rows())
    for path in (*(out / name for name in _FILES), options.json):
        if path is not None:
            require_writable(path)
    told, above, below = shown(lines), heading(settings, options.caption), list(notes(lines))
    text = markdown(told, settings, above, below)
    write_text(out / "table.md", text)
    write_csv(out / "table.csv", *_numbers(told, settings))
    drawn = [cells(line, settings) for line in told]
    write_figure(out / "table.png", drawing.table(header(), drawn, above, below), dpi=130)
    write_figure(out / "sizes.png", drawing.sizes(lines, above, settings["scale"]), dpi=130)
    if options.json is not None:
        write_json(options.json, {"notes": [*above, *below], "rows": _records(told, settings)})
    print(text)
    print("written:", ", ".join(str(out / name) for name in _FILES))


def header() -> list[str]:
    """The table's columns: each of the paper's figures twice, ours and the paper's."""
    pairs = [name for figure in FIGURES for name in (_HEADS[figure], "paper")]
    return ["Experiment", "Real", "Synthetic", *pairs, "Seeds"]


def cells(line: Line, settings: Settings) -> list[str]:
    """The cells of one row, in the columns of `header`."""
    pictures = ["–" if count is None else str(count) for count in _trained_on(line, settings)]
    pairs = []
    for name, (ours, papers) in _DIGITS.items():
        published = line.paper.get(name)
        pairs.append(_cell(line.ours[name], ours) if name in line.planned else "–")
        pairs.append("–" if published is None else f"{published:.{papers}f}")
    return [line.row.title, *pictures, *pairs, str(line.seeds)]


def heading(settings: Settings, caption: str) -> list[str]:
    """What a reader must know before the table."""
    counts = "{train} for training, {val} for validation, {test} for the test".format_map(settings["photos"])
    said = [f"{caption} Photographs: {counts}."]
    if settings["scale"] != 1.0:
        short = f"SHORTENED to a scale of {settings['scale']:g}: fewer pictures and steps, smaller input."
        said.insert(0, f"{short} These figures say nothing about the experiments.")
    return said


def notes(lines: Sequence[Line]) -> Iterator[str]:
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
    if any(not line.seeds for line in shown(lines)):
        yield "missing: not run yet, or its data is not there."


def markdown(lines: Sequence[Line], settings: Settings, above: Sequence[str], below: Sequence[str]) -> str:
    """The table as Markdown between what is said `above` and `below` it."""
    rows = [header(), ["---", *["---:"] * (len(header()) - 1)], *(cells(line, settings) for line in lines)]
    table = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([*(f"**{text}**\n" for text in above), *table, "", *(f"- {text}" for text in below), ""])


def _cell(cell: Cell, digits: int) -> str:
    if cell.mean is None:
        return "missing"
    if cell.deviation is None:
        return f"{cell.mean:.{digits}f}"
    return f"{cell.mean:.{digits}f} ± {cell.deviation:.{digits}f}"


def _trained_on(line: Line, settings: Settings) -> tuple[int | None, int | None]:
    """Real and synthetic pictures that the row's networks are trained on; None where it has no network."""
    if line.row.kind == "rule_based":
        return None, None
    return settings["photos"]["train"], scaled(line.count, settings["scale"])


def _records(lines: Sequence[Line], settings: Settings) -> list[dict[str, Any]]:
    """The table's numbers, one dict for each row; None where there is none."""
    records = []
    for line in lines:
        real, synthetic = _trained_on(line, settings)
        record: dict[str, Any] = {
            "experiment": line.row.name,
            "real": real,
            "synthetic": synthetic,
            "seeds": line.seeds,
        }
        for name in FIGURES:
            record[name] = line.ours[name].mean
            record[f"{name}_sd"] = line.ours[name].deviation
            record[f"{name}_paper"] = line.paper.get(name)
        records.append(record | {"scale": settings["scale"]})
    return records


def _numbers(lines: Sequence[Line], settings: Settings) -> tuple[list[str], list[list[Any]]]:
    records = _records(lines, settings)
    return list(records[0]), [list(record.values()) for record in records]


def _parser() -> argparse.ArgumentParser:
    made = parser("table", __doc__, package="experiments")
    made.add_argument("--runs", type=Path, default=OUT, metavar="DIR", help="--out of experiments.run")
    made.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the table (default: that of --runs)"
    )
    made.add_argument(
        "--caption", default=CAPTION, metavar="TEXT", help="what the photographs are, for the reader"
    )
    return made


if __name__ == "__main__":
    run(main)
