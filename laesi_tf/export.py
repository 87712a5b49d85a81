"""Export a training run as a small folder for use elsewhere: float16 weights, configuration and figures.

The exported model is loaded again and compared with the run on fresh scenes before it counts as exported.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from laesi_tf.cli import parser, run
from laesi_tf.data import synthetic
from laesi_tf.files import write_json
from laesi_tf.runs import EXPORTED, Run, export, load_run
from laesi_tf.tasks import task
from laesi_tf.training import assess

_BATCHES, _BATCH = 4, 32


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a run that is not there or a folder that cannot be written."""
    command = parser("export", __doc__)
    command.add_argument("run", type=Path, metavar="RUN", help="folder that train wrote")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    options = command.parse_args(arguments)
    original = load_run(options.run)
    export(original, options.out)
    figures = {
        "original": _figures(original),
        "exported": _figures(load_run(options.out)),
        "bytes": (options.out / EXPORTED).stat().st_size,
    }
    for name in ("original", "exported"):
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures[name].items()))
    print(f"written: {options.out}, weights {figures['bytes'] / 1e6:.1f} MB")
    if options.json is not None:
        write_json(options.json, figures)


def _figures(trained: Run) -> dict[str, float]:
    """The model's figures on the first scenes of the test stretch."""
    scenes = synthetic.batches(
        task="mask" if trained.config.task == "mask" else "area",
        batch_size=_BATCH,
        seed=0,
        size=trained.config.size,
        ranges=trained.config.ranges,
        start=synthetic.TEST[0],
        passes=1,
    )
    judged = task(trained.config)
    found = assess(trained.model, judged, list(itertools.islice(scenes, _BATCHES)))
    return {key: float(np.asarray(value)) for key, value in judged.figures(found).items()}


if __name__ == "__main__":
    run(main)
