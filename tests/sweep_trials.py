"""Small trials on discs, and their results. As a command: one trial in a fresh process, as JSON."""

import hashlib
import json
import sys
from collections.abc import Sequence
from typing import Any

import discs
import numpy as np
import tensorflow as tf
import tiny_backbone

from sweeps.trials.budget import Budget
from sweeps.trials.search_space import Point
from sweeps.trials.training_data import Batch, TrainingData
from sweeps.trials.trial_runner import TrialOutcome, TrialRunner

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


def make_discs(budget: Budget, indices: Sequence[int]) -> Batch:
    """Return discs in place of scenes."""
    samples = [discs.disc(index % 10**6, budget.size) for index in indices]
    shares = [mask.mean() for _, mask in samples]
    targets = np.float32([[100.0 * share + 1.0, np.nan, share] for share in shares])
    return tf.constant(np.stack([image for image, _ in samples])), tf.constant(targets)


def make_runner(budget: Budget = BUDGET) -> TrialRunner:
    """Return a runner of trials on discs."""
    return TrialRunner(budget, TrainingData(budget, threads=1, make_samples=make_discs))


def exact_outcome(runner: TrialRunner, point: Point, outcome: TrialOutcome) -> dict[str, Any]:
    """Return all results of a trial, exact to the last bit."""
    weights = hashlib.sha256(b"".join(v.numpy().tobytes() for v in runner.network(point).variables))
    return {
        "mre": outcome.mre.hex(),
        "losses": [loss.hex() for loss in outcome.losses],
        "predicted": outcome.results["predicted"].tobytes().hex(),
        "weights": weights.hexdigest(),
    }


if __name__ == "__main__":
    tf.config.threading.set_intra_op_parallelism_threads(int(sys.argv[2]))
    tiny_backbone.install()
    chosen = Point(*sys.argv[1].split(","))
    fresh = make_runner()
    print(json.dumps(exact_outcome(fresh, chosen, fresh.run(chosen, 0))))
    assert np.isfinite(fresh.measure_inference_ms(chosen))
