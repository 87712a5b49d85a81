"""Small trials on discs, and what they leave behind. As a command: one trial in a fresh process, as JSON."""

import hashlib
import json
import sys
from collections.abc import Sequence
from typing import Any

from sweeps.trials.budget import Budget
from sweeps.trials.search_space import Point
from sweeps.trials.training_data import Batch, TrainingData
from sweeps.trials.trial_runner import TrialOutcome, TrialRunner

# isort: split
import discs
import numpy as np
import tensorflow as tf

BUDGET = Budget(
    size=32,
    batch_size=8,
    steps=4,
    pictures=24,
    validation=64,
    calibration=32,
    alpha=0.35,
    large="large_minimalistic",
    weights_large="none",
    weights_small="none",
)


def made(budget: Budget, indices: Sequence[int]) -> Batch:
    """Discs in place of scenes."""
    discs_made = [discs.disc(index % 10**6, budget.size) for index in indices]
    shares = [mask.mean() for _, mask in discs_made]
    targets = np.float32([[100.0 * share + 1.0, np.nan, share] for share in shares])
    return tf.constant(np.stack([image for image, _ in discs_made])), tf.constant(targets)


def trainer(budget: Budget = BUDGET) -> TrialRunner:
    """A trainer on discs."""
    return TrialRunner(budget, TrainingData(budget, threads=1, made=made))


def told(trained: TrialRunner, point: Point, outcome: TrialOutcome) -> dict[str, Any]:
    """All that a trial gave, to the last bit."""
    weights = hashlib.sha256(b"".join(v.numpy().tobytes() for v in trained.model(point).variables))
    predicted = outcome.found["predicted"].tobytes().hex()
    return {
        "mre": outcome.mre.hex(),
        "losses": [loss.hex() for loss in outcome.losses],
        "predicted": predicted,
        "weights": weights.hexdigest(),
    }


if __name__ == "__main__":
    tf.config.threading.set_intra_op_parallelism_threads(int(sys.argv[2]))
    chosen = Point(*sys.argv[1].split(","))
    fresh = trainer()
    print(json.dumps(told(fresh, chosen, fresh.run(chosen, 0))))
    assert np.isfinite(fresh.inference_ms(chosen))
