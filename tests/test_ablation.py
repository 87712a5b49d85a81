"""Which scenes are trained on, what is compared with what, and that nothing is trained twice."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from green import save_run
from photo_sets import make_photo_set

from laesi_tf import ablate
from laesi_tf.benchmarks import ablation, component_cost
from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.common.errors import InputError
from laesi_tf.synthesis import load_ranges
from laesi_tf.training.config import TrainConfig


def test_each_component_is_removed_and_alone() -> None:
    variants = ablation.list_variants("phone", ablation.read_groups("phone"))
    base = load_ranges("phone").list_enabled_components()
    by_name = {(variant.change, variant.component): variant for variant in variants}
    assert len(variants) == len(by_name) == 2 * (len(base) - 1) + 2
    assert by_name["", ablation.ALL].ranges.list_enabled_components() == base
    assert by_name["", ablation.BARE].ranges.list_enabled_components() == ("empty_sheet",)
    assert set(by_name["only", "coin"].ranges.list_enabled_components()) == {"coin", "empty_sheet"}
    assert set(base) - set(by_name["without", "coin"].ranges.list_enabled_components()) == {"coin"}
    assert by_name["only", "coin"].reference == ablation.BARE
    with pytest.raises(InputError, match="no component 'snow'"):
        ablation.read_groups("phone", ["weather=coin+snow"])
    for arguments in (["things=coin", "things=pen"], ["=coin"], ["x/y=coin"]):
        with pytest.raises(InputError, match="a name of its own"):
            ablation.read_groups("phone", arguments)


def test_groups_change_together() -> None:
    groups = ablation.read_groups("phone", ["things=coin+pen", "jpeg"])
    assert groups == {"things": ("coin", "pen"), "jpeg": ("jpeg",)}
    by_name = {
        (variant.change, variant.component): set(variant.ranges.list_enabled_components())
        for variant in ablation.list_variants("phone", groups)
    }
    assert by_name["only", "things"] == {"coin", "pen", "empty_sheet"}
    everything = set(load_ranges("phone").list_enabled_components())
    assert everything - by_name["without", "things"] == {"coin", "pen"}


def test_interval_is_that_of_student() -> None:
    differences = np.array([1.0, 2.0, 4.0])
    low, high = ablation.interval_of_mean(differences)
    half = 4.302653 * differences.std(ddof=1) / np.sqrt(3)
    assert (low, high) == pytest.approx((7 / 3 - half, 7 / 3 + half))
    assert ablation.interval_of_mean(np.array([1.0])) == (None, None)


@pytest.mark.usefixtures("stand_in_networks")
def test_command_trains_each_once_and_writes_table_and_chart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[str] = []

    def fit(config: TrainConfig, out: Path, **_: Any) -> None:
        assert load_ranges(config.ranges) and config.steps == 7
        trained.append(f"{out.parents[1].name} {config.seed}")
        save_run(out, config.task)

    monkeypatch.setattr(ablation, "fit", fit)
    monkeypatch.setattr(
        component_cost, "measure_component_cost", lambda *_, **__: {"coin": MedianIqr(9.0, 1.0)}
    )
    manifest = make_photo_set(tmp_path)("image,mask,area_cm2,px_per_mm\na.png,masks/a.png,0.181,5\n")
    arguments = ["--photos", str(manifest), "--components", "coin", "--seeds", "2", "--steps", "7"]
    arguments += ["--out", str(tmp_path / "out")]
    ablate.main(arguments)
    folders = ("all-components", "no-component", "without-coin", "only-coin")
    assert trained == [f"{folder} {seed}" for seed in (0, 1) for folder in folders]
    with (tmp_path / "out" / "ablation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 2 and {row["us"] for row in rows if row["component"] == "coin"} == {"9.0"}
    # Stand-ins are all alike.
    assert {float(row["difference"]) for row in rows if row["change"]} == {0.0}
    ablate.main(arguments)
    assert len(trained) == 8
    other = [*arguments[:2], "--components", "coin=coin+pen", *arguments[4:]]
    ablate.main(other)
    assert trained[8:] == [f"{folder} {seed}" for seed in (0, 1) for folder in ("without-coin", "only-coin")]
    with pytest.raises(InputError, match="other settings"):
        ablate.main([*arguments, "--size", "64"])
    without = make_photo_set(tmp_path / "b")("image,area_cm2\na.png,0.181\n")
    with pytest.raises(InputError, match=r"a\.png needs a mask for task mask"):
        ablate.main(["--photos", str(without), "--out", str(tmp_path / "other")])
    assert not (tmp_path / "other").exists()
