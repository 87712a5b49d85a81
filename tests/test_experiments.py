"""The experiments, shortened to a few steps at 32 pixels."""

import json
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from discs import disc
from estimator_conformance import EstimatorConformance
from green import disk, mask_network, photo
from PIL import Image
from scenes import only

from experiments import datasets, experiment_specs, paths, runner
from experiments import run as command
from experiments.experiment_specs import Job, load_experiments, plan_jobs
from experiments.run import main
from laesi_tf.common.errors import InputError
from laesi_tf.data import dataset_spec
from laesi_tf.data.dataset_spec import DatasetSpec
from laesi_tf.data.mixture import load_mixture
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.keras_networks import MaskOnlyEstimator
from laesi_tf.synthesis import Ranges, load_ranges
from laesi_tf.training import loop, trainer

SCALE = 0.005
NAMES = ["rule_based", "real_baseline", "rendering_1", "rendering_2", "controlnet", "controlnet_filtering"]
Run = Callable[..., dict[str, Any]]
pytestmark = pytest.mark.usefixtures("tiny_backbone")


def write_manifest(folder: Path, *, masks: bool = True) -> Path:
    """Write a manifest of discs: four photos to train on, two in each other split."""
    splits = ["train"] * 4 + ["val"] * 2 + ["test"] * 2
    lines = ["image,area_cm2,split" + (",mask" if masks else "")]
    for index, split in enumerate(splits):
        image, mask = disc(index, 64)
        Image.fromarray(image).save(folder / f"{index}.png")
        Image.fromarray(mask * 255).save(folder / f"{index}_mask.png")
        area = 100 * mask.mean() + 1
        lines.append(f"{index}.png,{area},{split}" + (f",{index}_mask.png" if masks else ""))
    (folder / "manifest.csv").write_text("\n".join(lines))
    return folder / "manifest.csv"


def load_simple_ranges(source: str | Path) -> Ranges:
    """Load ranges without what takes long to compile and does not matter here."""
    return only("ruling", "calibration", "surface", ranges=load_ranges(source))


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="module")
def run(tiny_backbone: None, manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a function that runs experiments, of `tasks` alone, into a folder and returns their metrics."""
    data = tmp_path_factory.mktemp("data")

    def call(
        out: Path,
        *names: str,
        tasks: Sequence[str] = ("area", "mask"),
        photos: Path = manifest,
        scale: float = SCALE,
    ) -> dict[str, Any]:
        options = ["--photos", photos, "--out", out, "--data", data, "--json", data / "metrics.json"]
        options += ["--scale", scale, "--seeds", 1, "--weights", "none"]
        with pytest.MonkeyPatch.context() as patch:
            jobs = [job for job in plan_jobs(load_experiments(names), seeds=1) if job.task in tasks]
            patch.setattr(command, "plan_jobs", lambda *_, **__: jobs)
            patch.setattr(datasets, "load_ranges", load_simple_ranges)
            main([*names, *map(str, options)])
        metrics: dict[str, Any] = json.loads((data / "metrics.json").read_text())
        return metrics

    return call


@pytest.fixture(scope="module")
def finished(run: Run, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Run experiments without interruption; return their folder and metrics."""
    out = tmp_path_factory.mktemp("runs") / "experiments"
    metrics = run(out, "real_baseline", "controlnet")
    return out, metrics | run(out, "rule_based", "rendering_1", tasks=["area"])


def test_the_experiments_are_the_papers_with_its_results() -> None:
    experiments = load_experiments()
    assert [experiment.name for experiment in experiments] == NAMES
    paper = {experiment.name: experiment.paper[experiment.counts[0]] for experiment in experiments}
    assert paper["rule_based"] == {"val_mre": 38.3, "test_mre": 38.3}
    assert [list(paper[name].values()) for name in NAMES[1:]] == [
        [12.5, 12.9, 0.79, 0.08],
        [12.0, 11.0, 0.81, 0.07],
        [10.8, 11.3, 0.82, 0.07],
        [8.4, 10.0, 0.80, 0.09],
        [8.5, 9.2, 0.83, 0.05],
    ]
    assert experiments[-1].paper[10000] == {"val_mre": 6.1, "test_mre": 6.2}
    assert experiments[-1].counts == experiments[-2].counts == (5000, 6000, 7000, 8000, 9000, 10000)


def test_every_seed_has_every_row_and_masks_at_the_first_count_alone() -> None:
    jobs = plan_jobs(load_experiments(), seeds=3)
    assert len({job.folder for job in jobs}) == len(jobs)
    assert [job.seed for job in jobs] == sorted(job.seed for job in jobs)
    first = [job for job in jobs if job.seed == 0]
    masks = [job for job in first if job.task == "mask"]
    assert [job.experiment.name for job in masks] == NAMES[1:]
    assert all(job.count == job.experiment.counts[0] for job in masks)
    areas = [(job.experiment.name, job.count) for job in first if job.task == "area"]
    assert areas == [(one.name, count) for one in load_experiments() for count in one.counts]


@pytest.mark.parametrize("task", ["area", "mask"])
def test_all_rows_share_one_recipe_which_can_be_shortened(task: str) -> None:
    full = experiment_specs.job_config(task, scale=1.0)
    assert (full.task, full.size, full.optimizer) == (task, (160, 160), "rmsprop")
    assert full.learning_rate == 1e-3 and full.final_learning_rate == 1e-9 and full.schedule == "piecewise"
    short = experiment_specs.job_config(task, scale=0.36, seed=7)
    assert short.size == (96, 96) and short.steps == pytest.approx(0.36 * full.steps, abs=1)
    assert short.seed == 7 and full.seed == 0
    assert experiment_specs.job_config(task, scale=1e-4).steps == 1


def test_experiments_with_data_are_trained_and_measured_and_the_others_are_missing(
    finished: tuple[Path, dict[str, Any]],
) -> None:
    out, results = finished
    mask = results["real_baseline-0/mask-0"]
    for name in ("real_baseline-0", "rendering_1-5000"):
        area = results[f"{name}/area-0"]
        for split in ("val", "test"):
            assert area[split]["mre"] > 0 and area[split]["miou"] is None and area[split]["n"] == 1
            assert 0 <= mask[split]["miou"] <= 1 and mask[split]["mre"] is None
        # The training loop and the scoring of photos agree on the best model.
        metrics = json.loads((out / name / "area-0" / "metrics.json").read_text())
        assert area["val"]["mre"] == pytest.approx(metrics["mre"], rel=0.02)
    rules = results["rule_based-30/area-0"]
    assert rules["val"] == rules["test"] and rules["val"]["n"] == 1 and rules["val"]["miou"] is not None
    assert results["controlnet-5000/area-0"] is None and results["controlnet-5000/mask-0"] is None
    assert not (out / "controlnet-5000").exists()
    report = (out / "real_baseline-0" / "area-0" / "report.html").read_text()
    assert (
        "On the validation photos the area" in report and "synthetic" not in report.split("Configuration")[0]
    )


def test_each_row_is_trained_on_its_data(finished: tuple[Path, dict[str, Any]]) -> None:
    out, _ = finished
    real, rendered = (
        tomllib.loads((out / name / "mixture.toml").read_text())
        for name in ("real_baseline-0", "rendering_1-5000")
    )
    assert list(real) == ["photos"] and real["photos"]["split"] == "train" and real["photos"]["count"] == 1
    assert rendered["photos"] == real["photos"] and rendered["scenes"]["count"] == 25
    scenes = dataset_spec.read_spec(rendered["scenes"]["folder"])
    assert scenes.count == 25 and scenes.size == (32, 32) and "lighting_passes = 1" in scenes.ranges
    sources = load_mixture(out / "rendering_1-5000" / "mixture.toml", size=(32, 32), seed=0, needs_masks=True)
    assert [(source.name, source.weight) for source in sources] == [("photos", 1.0), ("scenes", 25.0)]


def test_finished_seeds_are_skipped(
    finished: tuple[Path, dict[str, Any]],
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, results = finished
    for name in ("fit", "score_photos"):
        monkeypatch.setattr(runner, name, lambda *_, **__: pytest.fail("run again"))
    repeated = run(out, "real_baseline", "rule_based")
    assert repeated == {name: results[name] for name in repeated} and len(repeated) == 3
    assert capsys.readouterr().out.count("finished before") == 3


def test_interrupted_experiments_continue_to_the_same_results(
    finished: tuple[Path, dict[str, Any]], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Interrupted while training, then while measuring."""
    out, (_, results) = tmp_path / "out", finished
    area = out / "real_baseline-0" / "area-0"

    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    for owner, name, left in (
        (loop.TrainingLoop, "_validate", "state.npz"),
        (runner, "score_photos", "best.keras"),
    ):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(owner, name, interrupt)
            run(out, "real_baseline", tasks=["area"])
        assert (area / left).is_file() and not (area / paths.MEASURED).exists()
    (resumed,) = run(out, "real_baseline", tasks=["area"]).values()
    assert resumed | {"minutes": 0} == results["real_baseline-0/area-0"] | {"minutes": 0}


def test_other_photos_scales_and_recipes_are_refused(
    finished: tuple[Path, dict[str, Any]], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, _ = finished
    with pytest.raises(InputError, match="other photos or at another scale"):
        run(out, "real_baseline", scale=0.01)
    with pytest.raises(InputError, match="other photos or at another scale"):
        run(out, "real_baseline", photos=write_manifest(tmp_path, masks=False))
    recipe = experiment_specs.job_config
    monkeypatch.setattr(runner, "job_config", lambda task, **keys: recipe(task, optimizer="adam", **keys))
    with pytest.raises(InputError, match="differs in optimizer"):
        run(out, "real_baseline")


def test_without_masks_areas_are_trained(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs: list[Job] = []
    metrics = {split: {"mre": 1.0, "miou": None} for split in ("val", "test")}
    monkeypatch.setattr(runner.ExperimentRunner, "run", lambda _, job: jobs.append(job) or metrics)
    results = run(tmp_path / "out", "real_baseline", photos=write_manifest(tmp_path, masks=False))
    assert [job.task for job in jobs] == ["area"] and results["real_baseline-0/mask-0"] is None
    assert "real_baseline, mask: missing: no masks" in capsys.readouterr().out


def test_a_seed_that_diverges_does_not_stop_the_others(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(*_: Any) -> None:
        raise trainer.TrainingDiverged("training diverged")

    monkeypatch.setattr(runner.ExperimentRunner, "run", diverge)
    assert run(tmp_path, "real_baseline") == {"real_baseline-0/area-0": None, "real_baseline-0/mask-0": None}


@pytest.mark.parametrize(
    ("count", "side", "form", "message"),
    [
        (5000, 32, "records", None),
        (4999, 32, "records", "4999 images; 5000 are needed"),
        (5000, 64, "records", "32 x 32 pixels"),
        (5000, 32, "folder", "records"),
    ],
)
def test_inpainted_records_must_be_enough_and_of_the_right_size(
    tmp_path: Path, count: int, side: int, form: str, message: str | None
) -> None:
    (experiment,) = load_experiments(["controlnet"])
    spec = DatasetSpec(count=count, size=(side, side), per_shard=1000, seed=0, format=form, ranges="")
    dataset_spec.start_dataset(tmp_path / experiment.folder, spec)
    job = Job(experiment=experiment, count=5000, task="area", seed=0)
    reason = datasets.explain_missing_data(job, tmp_path, size=(32, 32), scale=1.0)
    assert reason is None if message is None else reason is not None and message in reason


class TestMaskOnlyEstimator(EstimatorConformance):
    @pytest.fixture(scope="class")
    @classmethod
    def estimator(cls) -> Estimator:
        return MaskOnlyEstimator(mask_network((64, 64)), (64, 64))


@pytest.mark.parametrize("size", [(300, 300), (300, 450)])
def test_the_networks_own_mask_covers_the_photo(size: tuple[int, int]) -> None:
    mask = MaskOnlyEstimator(mask_network((96, 96)), (96, 96)).measure(photo(*size)).mask
    assert mask is not None
    expected = disk(*size)
    assert (mask & expected).sum() / (mask | expected).sum() > 0.95


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendering_3"], "unknown experiment 'rendering_3'"),
        (["--scale", "0"], "share above 0"),
        (["--scale", "1.5"], "share above 0"),
        (["--seeds", "0"], "from 1 up"),
        (["--photos", "nowhere.csv"], "nowhere.csv"),
        (["--weights", "nowhere.h5", "real_baseline", "--scale", "0.005"], "no weights file nowhere.h5"),
    ],
)
def test_bad_input_is_refused(arguments: Sequence[str], message: str, manifest: Path, tmp_path: Path) -> None:
    folders = ["--photos", manifest, "--out", tmp_path / "out", "--data", tmp_path / "data"]
    with pytest.raises(InputError, match=message):
        main([*map(str, folders), *arguments])


def test_a_manifest_without_the_three_splits_is_refused(tmp_path: Path) -> None:
    manifest = write_manifest(tmp_path)
    manifest.write_text(manifest.read_text().replace(",val,", ",train,"))
    with pytest.raises(InputError, match="no photo in split 'val'"):
        main(["--photos", str(manifest), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
