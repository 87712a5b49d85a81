"""The command, from its options to the trials of real worker processes."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from sweep_studies import write_finished_study

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.training.config_files import load_config
from sweeps import dashboard, run
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy
from sweeps.queue.trial_queue import TrialQueue
from sweeps.trials.search_space import POINTS
from sweeps.workers import grid_study, worker_settings
from sweeps.workers.worker_settings import WorkerSettings

SMALL = [n for n, p in enumerate(POINTS) if (p.start, p.optimizer) == ("small_imagenet", "sgd")][:3]
TINY = "--size 32 --batch-size 8 --steps 4 --pictures 16 --validation 64 --calibration 32 --alpha 0.35"
COMPOSE = Path(run.__file__).parent / "compose.yaml"


def make_arguments(folder: Path, *more: str) -> list[str]:
    tiny = [*TINY.split(), "--weights-small", "none", "--weights-large", "none", "--workers", "1"]
    return ["--storage", str(folder / "study.db"), *tiny, *more]


def open_grid(folder: Path, *more: str) -> GridQueue:
    """Open the study of point 3 as the command does, without running it."""
    options = run._make_parser().parse_args(make_arguments(folder, "--points", "3", *more))
    return grid_study.open_grid_study(run._make_settings(options), run._select_jobs(options))


def test_it_runs_points_and_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, both = f"{SMALL[0]}-{SMALL[1]}", f"{SMALL[0]}-{SMALL[2]}"
    run.main(make_arguments(tmp_path, "--points", first, "--json", str(tmp_path / "one.json")))
    assert json.loads((tmp_path / "one.json").read_text())["complete"] == 2
    with pytest.raises(InputError, match="steps is 4 there and 5 here"):
        run.main(make_arguments(tmp_path, "--points", both, "--steps", "5"))
    # Complete points are not repeated, and no worker is started if none is left.
    run.main(make_arguments(tmp_path, "--points", first))
    assert "2 complete, 0 pruned, 0 attempts failed" in capsys.readouterr().out
    summary = json.loads((tmp_path / "one.json").read_text())
    assert summary["best_mre"] > 0 and not summary["given_up"]
    checkpoints = sorted((tmp_path / "checkpoints").iterdir())
    assert checkpoints and load_config(checkpoints[0] / CONFIG_FILE).steps == 4


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--points", "7-x"], "is not a list of numbers"),
        (["--points", "0-19,5-3"], "5-3 is reversed"),
        (["--validation", "100"], "multiple of 64"),
        (["--large", "huge"], "must be large or large_minimalistic"),
        (["--weights-large", "absent.h5"], "no weights file"),
        (["--finalists", "3"], r"no storage .*study\.db"),
        (["--finalists", "3", "--sampler", "tpe"], "leave out --sampler"),
        (["--finalists", "3", "--points", "3"], "leave out --finalists"),
        (["--sampler", "tpe", "--points", "3"], "leave out --finalists, --spread and --sampler"),
        (["--trials", "3"], "add --sampler tpe"),
        (["--spread", "3"], r"no storage .*study\.db"),
        (["--spread", "3", "--finalists", "3"], "not allowed with"),
        (["--time-limit", "0"], "must be above 0"),
        (["--retries", "-1"], "must be 0 or more"),
        (["--json", "."], "is a folder"),
        (["--sampler", "random"], "invalid choice"),
        (["--folder", __file__], "is a file; name a folder"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    tmp_path: Path, more: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run.main(make_arguments(tmp_path, *more))
    assert not list(tmp_path.iterdir())


def test_finalists_need_a_complete_screening(tmp_path: Path) -> None:
    write_finished_study(str(tmp_path / "study.db"), np.ones((3, 2)), name="other")
    with pytest.raises(InputError, match=r"no study grid in .*; there are: other"):
        run.main(make_arguments(tmp_path, "--finalists", "3"))
    open_grid(tmp_path)
    with pytest.raises(InputError, match="1 of 1 points are open; finish it"):
        run.main(make_arguments(tmp_path, "--finalists", "3"))


def test_missing_weights_are_reported_before_any_worker_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sweeps.trials import trial_runner

    def refuse(*_: object, **__: object) -> None:
        raise InputError("no ImageNet weights for large (no route to host); pass --weights PATH")

    monkeypatch.setattr(trial_runner, "initialise_network", refuse)
    monkeypatch.setattr(grid_study, "run_worker_pool", lambda *_, **__: pytest.fail("a worker was started"))
    with pytest.raises(InputError, match=r"large_imagenet: .*no route to host.*pass --weights-large FILE"):
        run.main(make_arguments(tmp_path, "--points", "3"))


def test_a_study_with_points_given_up_ends_with_status_1(tmp_path: Path) -> None:
    queue = open_grid(tmp_path)
    while claim := queue.claim():
        queue.fail(claim, "failed on purpose")
    with pytest.raises(SystemExit) as ended:
        run.main(make_arguments(tmp_path, "--points", "3"))
    assert ended.value.code == 1
    assert open_grid(tmp_path, "--retries", "5").claim() is not None, "more retries than before are used"


def test_a_worker_that_starts_while_the_database_is_offline_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = run._make_parser().parse_args(make_arguments(tmp_path, "--points", "3"))
    settings = run._make_settings(options)
    attempts, open_queue = [], WorkerSettings.open_queue

    def fail_twice(self: WorkerSettings) -> TrialQueue:
        attempts.append(self)
        if len(attempts) < 3:
            raise InputError("cannot open the storage")
        return open_queue(self)

    monkeypatch.setattr(WorkerSettings, "open_queue", fail_twice)
    monkeypatch.setattr(worker_settings, "_RETRY_PAUSE_S", 0.0)
    assert settings.open_queue_patiently().name == "grid"
    attempts.clear()
    with pytest.raises(InputError, match="cannot open"):
        dataclasses.replace(settings, policy=RetryPolicy(patience_s=-1)).open_queue_patiently()


def test_the_compose_file_starts_existing_commands() -> None:
    services = yaml.safe_load(COMPOSE.read_text())["services"]
    assert set(services) == {"database", "workers", "dashboard"}
    assert "ports" not in services["database"]
    assert all(re.fullmatch(r"127\.0\.0\.1:\d+:8080", port) for port in services["dashboard"]["ports"])
    for name, module, parser in (
        ("workers", "run", run._make_parser()),
        ("dashboard", "dashboard", dashboard._make_parser()),
    ):
        command = re.sub(r"\$\{\w+:-(\w*)\}", r"\1", services[name]["command"]).split()
        assert command[:3] == ["python", "-m", f"sweeps.{module}"]
        assert parser.parse_args(command[3:]).storage.startswith("postgresql://")
