"""Training on several devices: the steps of one device, on two logical processors and in two processes."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from disc_runs import fit_discs, learning_curve, read_history, tiny_config
from scenes import only

from laesi_tf import train
from laesi_tf.common import run_files, schema
from laesi_tf.common.errors import InputError
from laesi_tf.data.batch_part import BatchPart
from laesi_tf.training.cluster import Cluster, read_cluster
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.input_pipeline import InputPipeline
from laesi_tf.training.replicas import Replicas, start_replicas
from laesi_tf.training.tasks import make_task

HERE = Path(__file__).parent
TWO = ["one:1", "two:2"]

COMPARE = """
import itertools, json
import numpy as np
import tensorflow as tf

processor, = tf.config.list_physical_devices("CPU")
tf.config.set_logical_device_configuration(processor, [tf.config.LogicalDeviceConfiguration()] * 2)
import tiny_backbone
from disc_runs import disc_stream, tiny_config
from laesi_tf.training.device_synthesis import render_on_replicas
from laesi_tf.training.replicas import ONE_DEVICE, start_replicas
from laesi_tf.training.replicated_trainer import make_trainer
from laesi_tf.training.tasks.area import AreaTask

tiny_backbone.install()
# A multiple of the gradient is another step of SGD, unlike of Adam; so is one that is clipped in parts.
config = tiny_config(optimizer="sgd", learning_rate=0.01)
mirrored = start_replicas("mirrored", config, print)
results = {"replicas": mirrored.count}

def train(replicas):
    trainer, _ = make_trainer(config, replicas)
    batches = itertools.islice(disc_stream(config)(0), 3)
    losses = [float(trainer.train_step(images, target)) for images, target in batches]
    with replicas.scope():
        trainer.recalibrate(lambda: [images for images, _ in itertools.islice(disc_stream(config)(0), 2)])
    return losses, np.concatenate([np.ravel(v.numpy()) for v in trainer.variables]).tolist()

results["mean"] = [train(replicas) for replicas in (ONE_DEVICE, mirrored)]

# A loss that is no mean over images, as that of the task `ruling`.
AreaTask.loss_is_mean_over_images = False
mean_loss = AreaTask.loss
AreaTask.loss = lambda *arguments: tf.sqrt(mean_loss(*arguments))
results["root"] = [train(replicas) for replicas in (ONE_DEVICE, mirrored)]

rendered = render_on_replicas(
    mirrored.strategy, lambda index: {"index": index}, lambda _, sample: (sample["index"], sample["index"]),
    batch_size=6, start=12,
)
parts = [mirrored.strategy.experimental_local_results(images) for images, _ in itertools.islice(rendered, 2)]
results["rendered"] = [[part.numpy().tolist() for part in batch] for batch in parts]
print(json.dumps(results))
"""

# Trains 2 steps to the end, then to 6, in whose fifth a worker that is not the chief stops moving.
WORK = """
import sys, time
from pathlib import Path
import tiny_backbone
from disc_runs import disc_stream, fit_discs, tiny_config
from laesi_tf.cli.console import run_command
from laesi_tf.training.follower import follow
from laesi_tf.training.replicas import start_replicas
from laesi_tf.training.tasks.area import AreaTask

AreaTask.loss_is_mean_over_images = False  # so that the processes exchange their outputs, as for `ruling`

def stuck(start):
    for step, batch in enumerate(disc_stream(tiny_config())(start), start // 8 + 1):
        if step == 5:
            time.sleep(600)
        yield batch

def work(_):
    configs = [tiny_config(steps=steps, schedule="constant", checkpoint_every=2) for steps in (2, 6)]
    replicas = start_replicas("multi-worker", configs[0], print)
    tiny_backbone.install()
    for config in configs:
        if replicas.is_chief:
            fit_discs(config, Path(sys.argv[1]), replicas=replicas)
        else:
            follow(config, replicas, train=stuck)

run_command(work)
"""


def test_steps_on_two_devices_are_those_of_one() -> None:
    results = json.loads(run(COMPARE).splitlines()[-1])
    assert results["replicas"] == 2
    for kind in ("mean", "root"):
        (losses, variables), (two_losses, two_variables) = results[kind]
        assert np.ptp(losses) > 0.1
        np.testing.assert_allclose(two_losses, losses, rtol=1e-4)
        np.testing.assert_allclose(two_variables, variables, rtol=1e-3, atol=1e-4)
    assert results["rendered"] == [[[12, 13, 14], [15, 16, 17]], [[18, 19, 20], [21, 22, 23]]]


@pytest.mark.usefixtures("tiny_backbone")
def test_two_processes_train_as_one_and_a_killed_worker_stops_both(tmp_path: Path) -> None:
    out, config = tmp_path / "run", tiny_config(steps=6, schedule="constant", checkpoint_every=2)
    with contextlib.ExitStack() as stack:
        chief, worker = start_workers(out, stack)
        fit_discs(config, tmp_path / "one")
        while not (out / run_files.HISTORY_FILE).is_file() or read_history(out)[-1]["step"] != "4":
            assert worker.poll() is None, worker.communicate()
            assert chief.poll() is None, chief.communicate()
            time.sleep(0.1)
        worker.send_signal(signal.SIGKILL)
        _, errors = chief.communicate(timeout=120)
    assert chief.returncode == 2
    (line,) = (line for line in errors.splitlines() if line.startswith("error: "))
    assert line.startswith("error: lost worker 1 at localhost:")
    assert "after step 4; saved up to step 4. Start all workers again with the same commands" in line
    assert provenance(out) | {"strategy": "multi-worker", "replicas": 2} == provenance(out)
    result = fit_discs(config, out)
    assert result.metrics["strategy"] == provenance(out)["strategy"] == "none"
    assert [row["step"] for row in learning_curve(out)] == ["2", "4", "6"]
    for row, expected in zip(learning_curve(out), learning_curve(tmp_path / "one"), strict=True):
        for key in ("train_loss", "val_loss"):
            assert float(row[key]) == pytest.approx(float(expected[key]), rel=1e-3)


def test_parts_of_a_batch_are_the_batch(tmp_path: Path) -> None:
    config = TrainConfig(
        size=(32, 32), batch_size=8, lighting_passes=2, augment="flip", ranges=flat(tmp_path)
    )
    whole, *parts = (
        next(iter(InputPipeline(config, replicas=replicas).training_batches(8)))
        for replicas in (Replicas(), *(Replicas(part=BatchPart(index, 2)) for index in range(2)))
    )
    for expected, *shares in zip(whole, *parts, strict=True):
        np.testing.assert_array_equal(np.concatenate(shares), expected)


def test_parts_of_a_mixture_are_the_mixture(tmp_path: Path) -> None:
    mixture = tmp_path / "mixture.toml"
    mixture.write_text('[only]\nkind = "live"\nweight = 1.0\n')
    config = TrainConfig(size=(32, 32), batch_size=4, mixture=str(mixture), ranges=flat(tmp_path))
    (expected, _), (images, _) = (
        next(iter(InputPipeline(config, replicas=replicas).training_batches(4)))
        for replicas in (Replicas(), Replicas(part=BatchPart(1, 2)))
    )
    np.testing.assert_array_equal(images, expected[2:])


@pytest.mark.parametrize("name", ["area", "mask"])
def test_losses_that_say_so_are_means_over_images(name: str) -> None:
    task, random = make_task(tiny_config(task=name)), np.random.default_rng(0)
    assert task.loss_is_mean_over_images
    shape = (8, 3) if name == "area" else (8, 16, 16)
    output = tf.constant(random.uniform(0.1, 0.9, shape if name == "area" else (*shape, 1)), tf.float32)
    target = tf.constant(random.uniform(0.1, 0.9, shape), tf.float32)
    target = target if name == "area" else tf.cast(target > 0.7, tf.uint8)
    halves = [float(task.loss(output[half], target[half])) for half in (slice(4), slice(4, 8))]
    assert float(task.loss(output, target)) == pytest.approx(np.mean(halves), rel=1e-5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"needs TF_CONFIG in the environment, such as"),
        ("{", "TF_CONFIG is not JSON"),
        ("[]", "no table 'cluster'"),
        ('{"cluster": {"worker": ["one:1", "two:2"]}}', "no table 'task'"),
        ('{"cluster": {"worker": "one:1"}, "task": {}}', "'worker' must be a list of HOST:PORT"),
        ('{"cluster": {"ps": ["one:1"]}, "task": {}}', "lists the job 'ps'"),
        ('{"cluster": {"worker": ["one:1"]}, "task": {}}', "0 chiefs and 1 workers; .* leave out --strategy"),
        ('{"cluster": {"worker": ["one:1", "one:1"]}, "task": {}}', "an address twice"),
        ('{"cluster": {"worker": ["one:1", "two"]}, "task": {}}', "'two' is not HOST:PORT"),
        (
            '{"cluster": {"worker": ["one:1", "two:2"]}, "task": {"type": "worker", "index": 2}}',
            "task 'worker' 2 is not one of its cluster's 2 processes",
        ),
    ],
)
def test_a_cluster_that_cannot_be_used_is_one_line(
    text: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TF_CONFIG", text)
    with pytest.raises(InputError, match=message):
        train.main(["--strategy", "multi-worker", "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()


def test_the_chief_is_the_first_process() -> None:
    jobs = {"worker": ["two:2"], "chief": ["one:1"]}
    task = {"type": "worker", "index": 0}
    assert read_cluster(json.dumps({"cluster": jobs, "task": task})) == Cluster(("one:1", "two:2"), 1, 1)
    task = {"type": "chief", "index": 0}
    assert read_cluster(json.dumps({"cluster": jobs, "task": task})).index == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"batch_size": 7}, "batch_size = 7 must be a multiple of the 2 devices of all workers"),
        ({"batch_size": 10, "lighting_passes": 2}, "2 workers makes 5 images of a batch"),
        ({"task": "mask", "copy_paste": 0.5}, "--copy-paste needs the whole batch"),
    ],
)
def test_what_workers_cannot_divide_is_refused(
    changes: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster = {"cluster": {"worker": TWO}, "task": {"type": "worker", "index": 0}}
    monkeypatch.setenv("TF_CONFIG", json.dumps(cluster))
    with pytest.raises(InputError, match=message):
        start_replicas("multi-worker", TrainConfig(**changes), print)


def test_one_device_and_a_named_renderer_are_refused() -> None:
    with pytest.raises(InputError, match=r"needs two devices or more, and TensorFlow sees 1 \(CPU:0\)"):
        start_replicas("mirrored", TrainConfig(), print)
    replicas = Replicas("mirrored", tf.distribute.MirroredStrategy(["CPU:0"]))
    with pytest.raises(InputError, match="leave out --strategy or --synthesis-device CPU:0"):
        InputPipeline(TrainConfig(), synthesis_device="CPU:0", replicas=replicas)


def test_a_worker_that_does_not_start_is_named() -> None:
    lines: list[str] = []
    cluster = Cluster((f"localhost:{free_port()}", "localhost:1"), 0)
    with pytest.raises(InputError, match=r"worker 1 does not answer at localhost:1 .* with its own index"):
        cluster.wait_for_all(lines.append, timeout_s=0.0)
    assert lines == ["waiting for worker 1 at localhost:1"]
    with socket.create_server(("", 0)) as taken:
        cluster = Cluster((f"localhost:{taken.getsockname()[1]}", "localhost:1"), 0)
        with pytest.raises(InputError, match="cannot listen on port"):
            cluster.wait_for_all(lines.append, timeout_s=0.0)


def run(script: str) -> str:
    process = subprocess.run(
        [sys.executable, "-c", script], env=environment(), capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


def start_workers(out: Path, stack: contextlib.ExitStack) -> list["subprocess.Popen[str]"]:
    """Start the two processes of WORK, which end with `stack`."""
    addresses = [f"localhost:{free_port()}" for _ in range(2)]
    started = []
    for index in range(2):
        cluster = {"cluster": {"worker": addresses}, "task": {"type": "worker", "index": index}}
        process = subprocess.Popen(
            [sys.executable, "-c", WORK, str(out)],
            env=environment() | {"TF_CONFIG": json.dumps(cluster)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        started.append(process)
    return started


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parent)])}


def free_port() -> int:
    with socket.create_server(("", 0)) as free:
        port: int = free.getsockname()[1]
    return port


def flat(folder: Path) -> str:
    """Write ranges of few components, which compile quickly; return their path."""
    path = folder / "flat.toml"
    path.write_text(f"without = {sorted(only('ruling', 'sensor_noise').without)}\n")
    return str(path)


def provenance(out: Path) -> dict[str, object]:
    table: dict[str, object] = schema.read_toml(out / run_files.CONFIG_FILE)["provenance"]
    return table
