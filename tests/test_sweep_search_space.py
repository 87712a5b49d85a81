"""What the 1,425 points are."""

import csv
import io
import json
from collections import Counter
from pathlib import Path

import pytest

from laesi_tf.common.errors import InputError
from laesi_tf.data.augmentation import AUGMENTATIONS, PAPER_AUGMENTATIONS, augmentation_flags
from laesi_tf.training.config import TrainConfig
from sweeps import grid
from sweeps.learning_rates import RateTrial, best_rates
from sweeps.trials import search_space


def test_every_combination_occurs_once() -> None:
    assert [len(levels) for levels in search_space.FACTORS.values()] == [3, 5, 5, 19]
    assert len(search_space.POINTS) == len(set(search_space.POINTS)) == 3 * 5 * 5 * 19 == 1425
    for factor, levels in search_space.FACTORS.items():
        counts = Counter(point.levels[factor] for point in search_space.POINTS)
        assert counts == {level: 1425 // len(levels) for level in levels}


def test_training_accepts_every_level() -> None:
    for point in search_space.POINTS:
        TrainConfig(optimizer=point.optimizer, schedule=point.schedule, augment=",".join(point.augmentations))


def test_the_augmentation_sets_are_none_all_the_papers_each_and_the_papers_without_each() -> None:
    sets = [frozenset(names) for names in search_space.AUGMENTATION_SETS.values()]
    paper = frozenset(PAPER_AUGMENTATIONS)
    expected = [frozenset(), frozenset(AUGMENTATIONS), paper]
    expected += [frozenset([name]) for name in AUGMENTATIONS] + [
        paper - {name} for name in PAPER_AUGMENTATIONS
    ]
    assert Counter(sets) == Counter(expected) and len(set(sets)) == 19
    for names in search_space.AUGMENTATION_SETS.values():
        assert augmentation_flags(names).sum() == len(names)


def test_the_papers_optimum_is_a_point() -> None:
    assert search_space.POINTS.count(search_space.OPTIMUM) == 1
    assert set(search_space.OPTIMUM.augmentations) == set(PAPER_AUGMENTATIONS)
    assert search_space.OPTIMUM.learning_rate == 1e-3
    assert search_space.OPTIMUM.final_learning_rate == pytest.approx(1e-9)


def test_the_learning_rates_are_those_that_were_measured() -> None:
    with (Path(grid.__file__).parent / "results" / "learning_rates.csv").open() as file:
        rows = list(csv.DictReader(file))
    numbers = {"rate": float, "seed": int, "mre": float}
    trials = [RateTrial(**{name: numbers.get(name, str)(row[name]) for name in row}) for row in rows]
    assert best_rates(trials) == search_space.LEARNING_RATES


def test_the_points_are_printed_and_written_as_csv(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grid.main([])
    printed = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    grid.main(["--out", str(tmp_path / "grid.csv"), "--json", str(tmp_path / "grid.json")])
    with (tmp_path / "grid.csv").open() as file:
        assert list(csv.DictReader(file)) == printed
    assert [int(row["number"]) for row in printed] == list(range(1425))
    assert [row["paper_optimum"] for row in printed].count("1") == 1
    for row, point in zip(printed, search_space.POINTS, strict=True):
        assert {factor: row[factor] for factor in search_space.FACTORS} == point.levels
        last = point.learning_rate if point.schedule == "constant" else 1e-6 * point.learning_rate
        assert float(row["learning_rate"]) == search_space.LEARNING_RATES[point.optimizer]
        assert float(row["final_learning_rate"]) == pytest.approx(last)
    assert len(json.loads((tmp_path / "grid.json").read_text())) == 1425


def test_help_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        grid.main(["--help"])
    assert "Print the 1,425 points of the search space as CSV" in capsys.readouterr().out


def test_a_folder_as_output_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        grid.main(["--out", str(tmp_path)])
