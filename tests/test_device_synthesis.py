"""An accelerator renders the pictures that the processor renders: tried on two logical processors."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from laesi_tf.common.errors import InputError
from laesi_tf.synthesis import COMPONENTS
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.device_synthesis import AUTO, CPU, find_synthesis_device
from laesi_tf.training.input_pipeline import InputPipeline

COMPARE = """
import itertools, json, sys
import numpy as np
import tensorflow as tf

processor, = tf.config.list_physical_devices("CPU")
tf.config.set_logical_device_configuration(processor, [tf.config.LogicalDeviceConfiguration()] * 2)
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.input_pipeline import InputPipeline

config = TrainConfig(size=(48, 48), batch_size=3, augment="flip", ranges=sys.argv[1], seed=5)
streams = [InputPipeline(config, synthesis_device=name).training_batches(6) for name in ("cpu", "CPU:1")]
results = []
for plain, rendered in itertools.islice(zip(*streams), 2):
    pictures = [np.asarray(images, int) for images, _ in (plain, rendered)]
    targets = [np.asarray(target, float) for _, target in (plain, rendered)]
    results.append({
        "device": rendered[0].device,
        "pictures": float(np.abs(pictures[0] - pictures[1]).max()),
        "spread": float(pictures[0].std()),
        "targets": float(np.abs(targets[0] - targets[1]).max()),
    })
print(json.dumps(results))
"""


def test_two_devices_render_the_same_batches(tmp_path: Path) -> None:
    # Few components, as each process compiles them anew.
    left_out = [name for name in COMPONENTS if name not in ("ruling", "paper_noise", "veins")]
    (tmp_path / "few.toml").write_text(f"base = 'rendering_2'\nwithout = {left_out}\n")
    command = [sys.executable, "-c", COMPARE, str(tmp_path / "few.toml")]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    for batch in json.loads(process.stdout.splitlines()[-1]):
        assert batch["device"].endswith("CPU:1")
        assert batch["spread"] > 10 and batch["pictures"] <= 1 and batch["targets"] < 1e-5


def test_without_an_accelerator_the_pipeline_renders() -> None:
    assert find_synthesis_device(AUTO) is None and find_synthesis_device(CPU) is None
    for name in ("gpu:7", "0"):
        with pytest.raises(InputError, match=f"no device '{name}'"):
            find_synthesis_device(name)
    assert find_synthesis_device("CPU:0") == "/device:CPU:0"


def test_what_a_device_cannot_render_is_refused() -> None:
    with pytest.raises(InputError, match="one light for each leaf"):
        InputPipeline(TrainConfig(lighting_passes=2), synthesis_device="cpu:0")
