"""Train and measure the experiments of the paper's table on your photos.

The manifest needs the splits train, val and test in its column `split`. The same command continues what was
stopped: finished seeds are passed over. What has no data is named and left out. `python -m experiments.table`
shows what comes of it.
"""

import argparse
import functools
import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import positive_float, positive_int
from laesi_tf.training.trainer import TrainingDiverged

# isort: split
import tensorflow as tf

from experiments.datasets import read_photos
from experiments.experiment_specs import Job, load_experiments, plan_jobs
from experiments.paths import DEFAULT_OUT, SETTINGS
from experiments.runner import ExperimentRunner, Metrics


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    # Each trial has graphs of its own, which TensorFlow takes for one that is traced again and again.
    tf.get_logger().setLevel(logging.ERROR)
    planned = plan_jobs(load_experiments(options.names or ()), seeds=options.seeds)
    study = ExperimentRunner(
        out=options.out,
        sets=options.data,
        photos=read_photos(options.photos, scale=options.scale),
        scale=options.scale,
        weights=options.weights,
    )
    for path in (options.out / SETTINGS, options.json):
        if path is not None:
            require_writable(path)
    study.begin()
    done = run_jobs(study, planned)
    if options.json is not None:
        write_json(options.json, done)


def run_jobs(study: ExperimentRunner, planned: Sequence[Job]) -> dict[str, Any]:
    """Run `planned` trials one after the other, telling of each; their figures, or None, by folder."""
    done: dict[str, Any] = {}
    begun, told = time.monotonic(), set()
    for number, trial in enumerate(planned, 1):
        there, found = study.finished(trial), _run_job(study, trial)
        if isinstance(found, str):
            done[str(trial.folder)] = None
            said = f"{trial.row.name}, {trial.task}: {found}"
        else:
            done[str(trial.folder)] = dict(found)
            minutes = (time.monotonic() - begun) / 60
            state = "finished before" if there else f"{minutes:.1f} minutes so far"
            said = f"{number}/{len(planned)} {trial}: {_describe_metrics(found)} ({state})"
        if said not in told:
            print(said, flush=True)
        told.add(said)
    return done


def _run_job(study: ExperimentRunner, trial: Job) -> Metrics | str:
    """The figures of `trial`, or why it has none."""
    if not study.finished(trial) and (reason := study.missing(trial)):
        return f"missing: {reason}"
    try:
        return study.run(trial)
    except TrainingDiverged as error:
        return str(error)


def _describe_metrics(figures: Metrics) -> str:
    said = []
    for split in ("val", "test"):
        found = figures[split]
        parts = [f"MRE {found['mre']:.1f} %"] if found["mre"] is not None else []
        parts += [f"mIoU {found['miou']:.3f}, MPE {found['mpe']:.3f}"] if found["miou"] is not None else []
        said.append(f"{split} {', '.join(parts) or 'nothing measured'}")
    return "; ".join(said)


def _make_parser() -> argparse.ArgumentParser:
    made = make_parser("run", __doc__, package="experiments")
    made.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"experiments to run, all where none is named: {', '.join(row.name for row in load_experiments())}",
    )
    made.add_argument(
        "--photos", type=Path, required=True, metavar="CSV", help="manifest: image,area_cm2,split,mask,..."
    )
    made.add_argument(
        "--seeds", type=positive_int, default=3, metavar="N", help="repetitions of each experiment"
    )
    made.add_argument(
        "--scale",
        type=functools.partial(positive_float, most=1.0, what="share"),
        default=1.0,
        metavar="SHARE",
        help="share of the pictures and steps, on smaller pictures: a shortened version, and marked as such",
    )
    made.add_argument("--weights", default="auto", help="what networks start from, as for laesi_tf.train")
    made.add_argument(
        "--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="folder for runs and figures"
    )
    made.add_argument(
        "--data",
        type=Path,
        default=Path("datasets"),
        metavar="DIR",
        help="folder of data sets: scenes are made in it, inpainted records are looked for in it",
    )
    return made


if __name__ == "__main__":
    run_command(main)
