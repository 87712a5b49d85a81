"""The command, from its options to the trials of real worker processes."""

import dataclasses
import json
import re
from pathlib import Path

import pytest
import yaml

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import CONFIG_FILE
from laesi_tf.training.config_files import load_config
from sweeps import dashboard, run
from sweeps.queue.study_storage import RetryPolicy
from sweeps.queue.trial_queue import TrialQueue
from sweeps.trials.search_space import POINTS
from sweeps.workers import process
from sweeps.workers.worker_settings import WorkerSettings

SMALL = [n for n, p in enumerate(POINTS) if (p.start, p.optimizer) == ("small_imagenet", "sgd")][:3]
TINY = "--size 32 --batch-size 8 --steps 4 --pictures 16 --validation 64 --calibration 32 --alpha 0.35"
COMPOSE = Path(run.__file__).parent / "compose.yaml"


def arguments(folder: Path, *more: str) -> list[str]:
    tiny = [*TINY.split(), "--weights-small", "none", "--weights-large", "none", "--workers", "1"]
    return ["--storage", str(folder / "study.db"), *tiny, *more]


def test_it_works_off_points_and_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, both = f"{SMALL[0]}-{SMALL[1]}", f"{SMALL[0]}-{SMALL[2]}"
    run.main(arguments(tmp_path, "--points", first, "--json", str(tmp_path / "one.json")))
    assert json.loads((tmp_path / "one.json").read_text())["complete"] == 2
    with pytest.raises(InputError, match="steps 4 there, 5 here"):
        run.main(arguments(tmp_path, "--points", both, "--steps", "5"))
    # What is done is not done again, and no worker is started where nothing is left.
    run.main(arguments(tmp_path, "--points", first))
    assert "2 complete, 0 pruned, 0 attempts failed" in capsys.readouterr().out
    figures = json.loads((tmp_path / "one.json").read_text())
    assert figures["best_mre"] > 0 and not figures["given_up"]
    checkpoints = sorted((tmp_path / "checkpoints").iterdir())
    assert checkpoints and load_config(checkpoints[0] / CONFIG_FILE).steps == 4


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--points", "7-x"], "is not numbers"),
        (["--points", "0-1425"], "is not within 0-1424"),
        (["--validation", "100"], "multiple of 64"),
        (["--large", "huge"], "neither large nor"),
        (["--weights-large", "absent.h5"], "no weights file"),
        (["--finalists", "3"], "screening is not complete"),
        (["--finalists", "3", "--sampler", "tpe"], "leave --sampler out"),
        (["--spread", "3"], "screening is not complete"),
        (["--spread", "3", "--finalists", "3"], "not allowed with"),
        (["--time-limit", "0"], "are not to be had"),
        (["--json", "."], "is a folder"),
        (["--sampler", "random"], "invalid choice"),
    ],
)
def test_bad_input(tmp_path: Path, more: list[str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        run.main(arguments(tmp_path, *more))


def test_a_study_with_points_given_up_ends_with_status_1(tmp_path: Path) -> None:
    options = run._make_parser().parse_args(arguments(tmp_path, "--points", "3"))
    orders = run._make_settings(options)
    ledger = orders.open()
    run._enqueue_jobs(ledger, run._select_jobs(options, ledger.store))
    while claim := ledger.claim():
        ledger.fail(claim, "as it was told")
    with pytest.raises(SystemExit) as ended:
        run.main(arguments(tmp_path, "--points", "3"))
    assert ended.value.code == 1
    ledger = run._make_settings(run._make_parser().parse_args(arguments(tmp_path, "--retries", "5"))).open()
    run._enqueue_jobs(ledger, run._select_jobs(options, ledger.store))
    assert ledger.claim() is not None, "more retries than before take it up again"


def test_a_worker_that_finds_the_database_away_comes_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    orders = run._make_settings(run._make_parser().parse_args(arguments(tmp_path, "--points", "3")))
    opened, open_it = [], WorkerSettings.open

    def away(self: WorkerSettings) -> TrialQueue:
        opened.append(self)
        if len(opened) < 3:
            raise InputError("cannot open the storage")
        return open_it(self)

    monkeypatch.setattr(WorkerSettings, "open", away)
    monkeypatch.setattr(process, "_RETRY_PAUSE_S", 0.0)
    assert process._open_queue(orders).name == "grid"
    opened.clear()
    with pytest.raises(InputError, match="cannot open"):
        process._open_queue(dataclasses.replace(orders, rules=RetryPolicy(patience_s=-1)))


def test_the_compose_file_starts_what_there_is() -> None:
    services = yaml.safe_load(COMPOSE.read_text())["services"]
    assert set(services) == {"database", "workers", "dashboard"}
    assert "ports" not in services["database"]
    assert all(re.fullmatch(r"127\.0\.0\.1:\d+:8080", port) for port in services["dashboard"]["ports"])
    for name, module, options in (
        ("workers", "run", run._make_parser()),
        ("dashboard", "watch", dashboard._make_parser()),
    ):
        written = services[name]["command"]
        command = re.sub(r"\$\{\w+:-(\w*)\}", r"\1", written).split()
        assert command[:3] == ["python", "-m", f"sweeps.{module}"]
        assert options.parse_args(command[3:]).storage.startswith("postgresql://")
