"""What the progress bar of a training shows."""

import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tensorflow as tf
from disc_runs import tiny_config
from tqdm import tqdm

from laesi_tf.training import loop
from laesi_tf.training.run_directory import TrainingProgress
from laesi_tf.training.trainer import TrainedStep

PAUSE_S = 0.3


class SlowLoop(loop.TrainingLoop):
    """A loop of steps that take no time and validations that take long."""

    def _validate(self) -> dict[str, float]:
        time.sleep(PAUSE_S)
        row = {"step": self.progress.step, "val_mre": 40.0, "images_per_s": 300.0}
        self.progress.history.append(row)
        return row

    def _save(self) -> None:
        """Save nothing."""


def test_the_loss_is_shown_at_once_and_the_time_left_does_not_count_validations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bars: list[tqdm[Any]] = []
    make_bar, shown = loop.progress_bar, []

    def keep_bar(*arguments: Any, **options: Any) -> "tqdm[Any]":
        bars.append(make_bar(*arguments, **options))
        return bars[0]

    def train_steps(*_: Any, **__: Any) -> Iterator[TrainedStep]:
        for number in range(1, 7):
            yield TrainedStep(number, images=None, loss=0.5)
            shown.append((time.monotonic() - started - bars[0].format_dict["elapsed"], bars[0].postfix))

    monkeypatch.setattr(loop, "progress_bar", keep_bar)
    monkeypatch.setattr(loop, "train_steps", train_steps)
    trainer = SimpleNamespace(
        task=SimpleNamespace(main_metric="mre"), optimizer=SimpleNamespace(iterations=tf.Variable(0))
    )
    config = tiny_config(steps=6, validate_every=2)
    started = time.monotonic()
    SlowLoop(config, tmp_path, trainer, TrainingProgress(), lambda start: iter(()), []).run(
        show_progress=True
    )
    assert [text for _, text in shown] == ["loss 0.5"] * 2 + ["loss 0.5, mre 40, 300 images/s"] * 3
    assert shown[-1][0] - shown[0][0] >= 2 * PAUSE_S
