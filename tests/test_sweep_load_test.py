"""Many workers on one PostgreSQL server, and the files that start them on clusters."""

import json
import os
import re
import shlex
import subprocess
from datetime import datetime, timedelta
from pathlib import Path

import fake_sweep_worker as fake
import optuna
import postgres
import pytest
import yaml
from optuna.trial import FrozenTrial, TrialState

from laesi_tf.common.errors import InputError
from sweeps import load_test, run
from sweeps.queue.trial_queue import JOB, REASON

SWEEPS = Path(run.__file__).parent


def make_trial(job: str, state: TrialState, second: int, **attributes: str) -> FrozenTrial:
    trial = optuna.create_trial(
        state=state,
        values=[1.0] if state is TrialState.COMPLETE else None,
        user_attrs={JOB: job, **attributes},
    )
    trial.datetime_start = datetime(2026, 1, 1)
    trial.datetime_complete = datetime(2026, 1, 1) + timedelta(seconds=second)
    return trial


def test_missing_and_repeated_points_are_counted() -> None:
    trials = [
        make_trial("0000", TrialState.COMPLETE, 2),
        make_trial("0001", TrialState.FAIL, 3, **{REASON: "lost"}),
        make_trial("0001", TrialState.COMPLETE, 4),
        make_trial("0001", TrialState.COMPLETE, 5),
    ]
    figures = load_test.summarise_trials(trials, points=4)
    assert (figures["complete"], figures["missing"], figures["duplicates"]) == (2, 2, 1)
    assert figures["failures"] == {"lost": 1}
    assert figures["points_per_s"] == pytest.approx(2 / 5)
    assert load_test.summarise_trials([], points=4)["missing"] == 4


@postgres.needs_postgres
def test_killed_workers_lose_and_repeat_no_point(
    server: postgres.Server,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(load_test, "_HEARTBEAT_S", 1)
    monkeypatch.setattr(load_test, "MISSED_HEARTBEATS", 2)
    storage = server.create_database(tmp_path.name)
    sizes = ["--workers", "4", "--points", "40", "--trial-s", "0.1", "--kill", "0.25"]
    load_test.main(["--storage", storage, *sizes, "--json", str(tmp_path / "figures.json")])
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert (figures["complete"], figures["missing"], figures["duplicates"]) == (40, 0, 0)
    assert figures["killed"] == 1
    assert "4 workers, 1 of them killed; 40 points" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"allows 100 connections and 64 workers need up to 202"):
        load_test.main(["--storage", storage])
    fake.open_queue(storage)
    with pytest.raises(InputError, match="study study exists"):
        load_test.main(["--storage", storage, "--study", "study", "--workers", "1"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--storage", "study.db"], "is a file, which one machine can use"),
        (["--storage", "mysql://x/y"], "is not supported"),
        (["--storage", "postgresql://x/y", "--points", "2000"], "the grid has 1425"),
        (["--storage", "postgresql://x/y", "--kill", "1.5"], "is not a share above 0 and up to 1"),
        (["--storage", "postgresql://x/y", "--workers", "0"], "from 1 up"),
        ([], "required: --storage"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        load_test.main(arguments)
    assert "\n" not in str(raised.value)


def test_the_slurm_script_starts_a_worker_in_each_task(tmp_path: Path) -> None:
    script = SWEEPS / "slurm.sh"
    options = dict(re.findall(r"^#SBATCH --([\w-]+)(?:=(\S+))?$", script.read_text(), re.MULTILINE))
    assert options["array"] == "0-63" and options["signal"] == "TERM@90" and "requeue" in options
    srun = tmp_path / "srun"
    srun.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    srun.chmod(0o755)
    environment = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "LAESI_STORAGE": "postgresql://laesi@host/sweep",
        "LAESI_OPTIONS": "--size 64 --steps 80",
    }
    done = subprocess.run([script], env=environment, capture_output=True, text=True, cwd=tmp_path)
    words = done.stdout.split()
    assert words[:3] == ["python", "-m", "sweeps.run"], done.stderr
    parsed = run._make_parser().parse_args(words[3:])
    assert (parsed.workers, parsed.threads, parsed.size) == (1, 1, 64)
    del environment["LAESI_STORAGE"], environment["LAESI_OPTIONS"]
    refused = subprocess.run([script], env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert refused.returncode and "LAESI_STORAGE: set it to postgresql://" in refused.stderr


def test_the_kubernetes_job_starts_a_worker_in_each_pod() -> None:
    claim, job = yaml.safe_load_all((SWEEPS / "kubernetes.yaml").read_text())
    pod = job["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert container["command"] == ["python", "-m", "sweeps.run"]
    parsed = run._make_parser().parse_args(container["args"])
    assert parsed.storage.startswith("postgresql://") and (parsed.workers, parsed.threads) == (1, 1)
    # The work-queue pattern: parallel pods without a number of completions; both policies need `Never`.
    assert job["spec"]["parallelism"] == 64 and "completions" not in job["spec"]
    assert pod["restartPolicy"] == "Never"
    rules = job["spec"]["podFailurePolicy"]["rules"]
    assert rules[0]["onExitCodes"] == {"containerName": container["name"], "operator": "In", "values": [2]}
    assert pod["volumes"][0]["persistentVolumeClaim"]["claimName"] == claim["metadata"]["name"]
    assert container["volumeMounts"][0]["mountPath"] == str(parsed.folder)


def test_the_compose_file_lets_its_server_take_many_workers() -> None:
    database = yaml.safe_load((SWEEPS / "compose.yaml").read_text())["services"]["database"]
    assert shlex.split(database["command"]) == ["postgres", "-c", "max_connections=300"]
