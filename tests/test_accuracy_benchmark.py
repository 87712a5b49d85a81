"""The comparison of methods: which there are, which no other beats, and the files that the command writes."""

import csv
from pathlib import Path

import pytest
from photo_sets import make_photo_set

from laesi_tf import benchmark
from laesi_tf.benchmarks.accuracy import find_front
from laesi_tf.benchmarks.methods import SHIPPED, list_methods
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import select_by_name
from laesi_tf.estimators.factory import WITHOUT_RUN


def row(name: str, ms: float, mre: float | None, *, refused: int = 0) -> dict[str, object]:
    return {"method": name, "ms": ms, "mre_percent": mre, "refused": refused, "n": 10}


def test_front_holds_what_no_other_beats_in_both() -> None:
    rows = [
        row("slow and good", 100, 1.0),
        row("fast and bad", 10, 50.0),
        row("slower and no better", 120, 1.0),
        row("fastest, refuses most", 1, 0.1, refused=6),
        row("measures nothing", 2, None, refused=10),
        row("middle", 50, 20.0),
        row("middle, beaten", 60, 30.0),
    ]
    assert [one["method"] for one in find_front(rows)] == ["fast and bad", "middle", "slow and good"]


def test_every_estimator_without_a_run_is_a_method() -> None:
    methods = list_methods()
    assert {*WITHOUT_RUN, SHIPPED, "regression"} <= {method.name for method in methods}
    shipped = select_by_name(methods, [SHIPPED], "method")[0]
    assert shipped.model_bytes > 1e6 and shipped.training_minutes == pytest.approx(77.4, abs=0.1)
    assert len({method.digest for method in methods if method.models}) == 3


def test_unknown_and_repeated_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no method is called 'magic'"):
        select_by_name(list_methods(), ["magic"], "method")
    with pytest.raises(InputError, match="two models are called small"):
        list_methods([tmp_path / "a" / "small", tmp_path / "b" / "small"])


def test_command_writes_table_and_chart(tmp_path: Path) -> None:
    manifest = make_photo_set(tmp_path)("image,area_cm2,px_per_mm\na.png,0.181,5\nb.png,0.181,5\n")
    out = tmp_path / "out"
    benchmark.main(
        [
            *("accuracy", "--photos", str(manifest), "--methods", "excess_green"),
            *("--timed", "1", "--out", str(out), "--json", str(tmp_path / "all.json")),
        ]
    )
    with (out / "speed_accuracy.csv").open(newline="") as file:
        (result,) = csv.DictReader(file)
    assert result["set"] == "set" and result["n"] == "2" and float(result["mre_percent"]) < 10
    assert float(result["first_area_s"]) > 0 and float(result["peak_mb"]) > 50
    assert "excess_green" in (out / "speed_accuracy.md").read_text()
    assert (out / "speed_accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_without_photos_it_says_what_to_name() -> None:
    with pytest.raises(InputError, match="--photos"):
        benchmark.main(["accuracy"])
