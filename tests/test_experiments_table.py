"""The table of the experiments, from invented metrics."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from experiments import figures, table
from experiments.experiment_specs import load_experiments
from experiments.results import collect_rows
from laesi_tf.common.errors import InputError

VAL = {"area-0": 10.0, "area-1": 13.0, "area-2": 11.5}
TEST = {"area-0": 20.0, "area-1": 21.0, "area-2": 25.0}
IOU = {"mask-0": 0.8, "mask-1": 0.9, "mask-2": 0.82}
MPE = {"mask-0": 0.05, "mask-1": 0.06, "mask-2": 0.1}


def make_metrics(**values: Any) -> dict[str, Any]:
    return {"mre": None, "miou": None, "mpe": None, "refused": 0} | values


def write_job(
    out: Path, group: str, job: str, val: dict[str, Any], test: dict[str, Any], **more: Any
) -> None:
    folder = out / group / job
    folder.mkdir(parents=True)
    (folder / "photos.json").write_text(json.dumps({"val": val, "test": test} | more))


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Write three seeds of the real baseline, one of rendering_2 at two counts, one by rules."""
    out = tmp_path / "runs"
    out.mkdir()
    for name in VAL:
        write_job(
            out,
            "real_baseline-0",
            name,
            make_metrics(mre=VAL[name]),
            make_metrics(mre=TEST[name]),
            weights_origin="W",
        )
    for name in IOU:
        test = make_metrics(miou=IOU[name], mpe=MPE[name], refused=125)
        write_job(out, "real_baseline-0", name, make_metrics(miou=0.1, mpe=0.9, refused=125), test)
    for count, mre in ((5000, 7.0), (10000, 6.0)):
        write_job(
            out, f"rendering_2-{count}", "area-0", make_metrics(mre=mre), make_metrics(mre=mre + 1, refused=2)
        )
    rules = make_metrics(mre=50.0, miou=0.4, mpe=0.5, refused=7)
    write_job(out, "rule_based-30", "area-0", rules, rules)
    write_settings(out, 1.0)
    return out


def write_settings(out: Path, scale: float) -> None:
    photos = {"train": 450, "val": 125, "test": 125}
    (out / "settings.json").write_text(json.dumps({"scale": scale, "photos": photos, "manifest": "x"}))


def write_table(runs: Path, *options: str) -> tuple[str, list[dict[str, str]]]:
    """Run the command without drawing; return table.md and the rows of table.csv."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table, "write_figure", lambda *_, **__: None)
        table.main(["--runs", str(runs), *options])
    with (runs / "table.csv").open(encoding="utf-8", newline="") as file:
        return (runs / "table.md").read_text(encoding="utf-8"), list(csv.DictReader(file))


def find_row(text: str, title: str, synthetic: str) -> list[str]:
    """Return the cells of a row of the Markdown table."""
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if "|" in line]
    (found,) = [cells for cells in rows if cells[0] == title and cells[2] == synthetic]
    return found


def test_results_are_means_and_deviations_over_seeds(runs: Path) -> None:
    text, numbers = write_table(runs)
    (found,) = [record for record in numbers if record["experiment"] == "real_baseline"]
    sources = {"val_mre": VAL, "test_mre": TEST, "miou": IOU, "mpe": MPE}
    for name, source in sources.items():
        values = np.array(list(source.values()))
        assert float(found[name]) == pytest.approx(values.mean())
        assert float(found[f"{name}_sd"]) == pytest.approx(values.std(ddof=1))
    shown = find_row(text, "Real data baseline", "0")
    assert shown[1] == "450" and shown[-1] == "3"
    assert shown[3:7] == ["11.5 ± 1.5", "12.5", "22.0 ± 2.6", "12.9"]
    assert shown[7:11] == ["0.840 ± 0.053", "0.79", "0.070 ± 0.026", "0.08"]


def test_one_seed_has_no_deviation_and_larger_counts_have_no_masks(runs: Path) -> None:
    text, numbers = write_table(runs)
    assert find_row(text, "Rendering 2", "5000")[3:] == [
        *("7.0", "10.8", "8.0", "11.3", "missing", "0.82", "missing", "0.07", "1")
    ]
    assert find_row(text, "Rendering 2", "10000")[3:] == ["6.0", "–", "7.0", "–", "–", "–", "–", "–", "1"]
    assert not any("7500" in record["synthetic"] for record in numbers)
    assert "Rendering 2, 5000: 2 photographs refused" in text


def test_rows_that_were_not_run_are_missing_beside_the_papers_results(runs: Path) -> None:
    text, numbers = write_table(runs)
    cells = ["missing", "8.4", "missing", "10.0", "missing", "0.80", "missing", "0.09", "0"]
    assert find_row(text, "ControlNet", "5000")[3:] == cells
    best = ["missing", "6.1", "missing", "6.2", "–", "–", "–", "–", "0"]
    assert find_row(text, "ControlNet + filtering", "10000")[3:] == best
    (found,) = [record for record in numbers if record["experiment"] == "rendering_1"]
    assert found["val_mre"] == found["miou_sd"] == "" and found["val_mre_paper"] == "12.0"
    assert "missing: not run yet" in text


def test_a_note_says_what_the_rules_were_measured_on(runs: Path) -> None:
    text, _ = write_table(runs)
    assert find_row(text, "Rule-based baseline", "–")[1:] == [
        *("–", "–", "50.0", "38.3", "50.0", "38.3", "0.400", "–", "0.500", "–", "1")
    ]
    assert "rendered scenes with red squares" in text and "7 of all were refused" in text


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_the_photos_are_described_and_a_shortened_version_is_marked(
    runs: Path, scale: float, tmp_path: Path
) -> None:
    write_settings(runs, scale)
    text, numbers = write_table(
        runs, "--caption", "Semi-real composites stand in.", "--json", str(tmp_path / "a.json")
    )
    written = json.loads((tmp_path / "a.json").read_text())
    before = text[: text.index("| Experiment")]
    assert "Semi-real composites stand in." in before and "450 for training" in before
    assert ("SHORTENED to a scale of 0.1" in before) == (scale != 1.0)
    assert any("SHORTENED" in note for note in written["notes"]) == (scale != 1.0)
    assert {float(record["scale"]) for record in numbers} == {scale}
    assert [record["experiment"] for record in written["rows"]] == [
        record["experiment"] for record in numbers
    ]
    assert find_row(text, "Rendering 1", str(round(5000 * scale)))[1] == "450"


def test_without_a_caption_the_photos_are_not_taken_for_the_papers(runs: Path) -> None:
    assert "not the paper's" in write_table(runs)[0]


def test_table_and_chart_are_drawn(runs: Path, tmp_path: Path) -> None:
    table.main(["--runs", str(runs), "--out", str(tmp_path / "out")])
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(table._FILES)
    for name in ("table.png", "sizes.png"):
        with Image.open(tmp_path / "out" / name) as picture:
            assert min(picture.size) > 300 and np.asarray(picture.convert("L")).std() > 5


def test_the_chart_has_our_results_the_papers_and_the_real_baseline(runs: Path) -> None:
    (axes,) = figures.plot_error_by_size(collect_rows(runs, load_experiments()), ["A."], 1.0).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert lines["Real data baseline"].get_ydata() == pytest.approx([11.5, 11.5])
    assert lines["Real data baseline, paper"].get_ydata() == pytest.approx([12.5, 12.5])
    filtered = lines["ControlNet + filtering, paper"]
    assert list(filtered.get_xdata()) == [5000, 10000] and list(filtered.get_ydata()) == [8.5, 6.1]
    (ours,) = [bar for bar in axes.containers if bar.get_label() == "Rendering 2"]
    assert list(ours.lines[0].get_xdata()) == [5000, 10000] and list(ours.lines[0].get_ydata()) == [7.0, 6.0]


def test_the_chart_of_a_shortened_run_has_the_papers_results_at_the_papers_counts(runs: Path) -> None:
    (axes,) = figures.plot_error_by_size(collect_rows(runs, load_experiments()), ["A."], 0.1).axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert list(lines["ControlNet + filtering, paper"].get_xdata()) == [5000, 10000]
    (ours,) = [bar for bar in axes.containers if bar.get_label() == "Rendering 2"]
    assert list(ours.lines[0].get_xdata()) == [500, 1000]
    assert axes.get_xscale() == "log"


def test_a_row_whose_photos_were_all_refused_is_not_called_missing(runs: Path) -> None:
    refused = make_metrics(refused=125)
    write_job(runs, "rendering_1-5000", "area-0", refused, refused)
    write_job(
        runs, "rendering_1-5000", "mask-0", make_metrics(miou=0.5, mpe=0.2), make_metrics(miou=0.5, mpe=0.2)
    )
    text, _ = write_table(runs)
    cells = find_row(text, "Rendering 1", "5000")
    assert cells[3:] == ["refused", "12.0", "refused", "11.0", "0.500", "0.81", "0.200", "0.07", "1"]
    assert "refused: measured, but every photograph was refused" in text
    assert "Rendering 1, 5000: 250 photographs refused" in text


def test_bad_input_is_refused(tmp_path: Path, runs: Path) -> None:
    with pytest.raises(InputError, match=r"run python -m experiments\.run"):
        table.main(["--runs", str(tmp_path / "nowhere")])
    with pytest.raises(InputError, match="cannot write"):
        table.main(["--runs", str(runs), "--out", str(runs / "settings.json")])
    (runs / "real_baseline-0" / "area-0" / "photos.json").write_text("{")
    with pytest.raises(InputError, match="broken"):
        table.main(["--runs", str(runs)])
