"""Check that an exported network equals the run it comes from."""

import itertools

import numpy as np

from laesi_tf.data import synthetic
from laesi_tf.runs import Run
from laesi_tf.tasks import task
from laesi_tf.training import assess

_BATCHES, _BATCH = 4, 32


def compute_test_metrics(trained: Run) -> dict[str, float]:
    """The model's figures on the first scenes of the test stretch."""
    scenes = synthetic.synthetic_batches(
        task="mask" if trained.config.task == "mask" else "area",
        batch_size=_BATCH,
        seed=0,
        size=trained.config.size,
        ranges=trained.config.ranges,
        start=synthetic.TEST_INDICES[0],
        passes=1,
    )
    judged = task(trained.config)
    found = assess(trained.model, judged, list(itertools.islice(scenes, _BATCHES)))
    return {key: float(np.asarray(value)) for key, value in judged.figures(found).items()}
