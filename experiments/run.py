"""Train and measure the experiments of the paper's table on your photos.

The manifest needs the splits train, val and test in its column `split`. The same command continues what was
stopped; finished seeds are skipped. Experiments without data are named and skipped. `python -m
experiments.table` writes the table.
"""

import argparse
import functools
import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.experiment_specs import Job, load_experiments, plan_jobs
from experiments.paths import DEFAULT_OUT, SETTINGS
from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import positive_float, positive_int

if TYPE_CHECKING:
    from experiments.runner import ExperimentRunner, Metrics


def main(arguments: Sequence[str]) -> None:
    """Run the jobs that are not finished. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    jobs = plan_jobs(load_experiments(options.names or ()), seeds=options.seeds)
    require_writable(options.out / SETTINGS)
    load_tensorflow()
    import tensorflow as tf

    from experiments.datasets import read_photos
    from experiments.runner import ExperimentRunner

    # Each job has its own graphs, which TensorFlow mistakes for one that is retraced.
    tf.get_logger().setLevel(logging.ERROR)
    runner = ExperimentRunner(
        out=options.out,
        data=options.data,
        photos=read_photos(options.photos, scale=options.scale),
        scale=options.scale,
        weights=options.weights,
    )
    runner.save_settings()
    metrics = run_jobs(runner, jobs)
    if options.json is not None:
        write_json(options.json, metrics)


def run_jobs(runner: "ExperimentRunner", jobs: Sequence[Job]) -> dict[str, Any]:
    """Run `jobs` one after the other, printing a line for each; return their metrics, or None, by folder."""
    results: dict[str, Any] = {}
    started, printed = time.monotonic(), set()
    for number, job in enumerate(jobs, 1):
        was_finished, result = runner.is_finished(job), _run_job(runner, job)
        if isinstance(result, str):
            results[str(job.folder)] = None
            line = f"{job.experiment.name}, {job.task}: {result}"
        else:
            results[str(job.folder)] = dict(result)
            minutes = (time.monotonic() - started) / 60
            state = "finished before" if was_finished else f"{minutes:.1f} minutes so far"
            line = f"{number}/{len(jobs)} {job}: {_describe_metrics(result)} ({state})"
        if line not in printed:
            print(line, flush=True)
        printed.add(line)
    return results


def _run_job(runner: "ExperimentRunner", job: Job) -> "Metrics | str":
    """Return the metrics of `job`, or why it has none."""
    from laesi_tf.training.trainer import TrainingDiverged

    if not runner.is_finished(job) and (reason := runner.explain_missing(job)):
        return f"missing: {reason}"
    try:
        return runner.run(job)
    except TrainingDiverged as error:
        return str(error)


def _describe_metrics(metrics: "Metrics") -> str:
    splits = []
    for name in ("val", "test"):
        found = metrics[name]
        parts = [f"MRE {found['mre']:.1f} %"] if found["mre"] is not None else []
        parts += [f"mIoU {found['miou']:.3f}, MPE {found['mpe']:.3f}"] if found["miou"] is not None else []
        splits.append(f"{name} {', '.join(parts) or 'nothing measured'}")
    return "; ".join(splits)


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("run", __doc__, package="experiments")
    names = ", ".join(experiment.name for experiment in load_experiments())
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"experiments to run (default: all): {names}"
    )
    parser.add_argument(
        "--photos", type=Path, required=True, metavar="CSV", help="manifest: image,area_cm2,split,mask,..."
    )
    parser.add_argument(
        "--seeds", type=positive_int, default=3, metavar="N", help="repetitions of each experiment"
    )
    parser.add_argument(
        "--scale",
        type=functools.partial(positive_float, most=1.0, what="share"),
        default=1.0,
        metavar="SHARE",
        help="share of the images and steps, on smaller images: a shortened version for a quick check",
    )
    parser.add_argument("--weights", default="auto", help="initial weights, as for laesi_tf.train")
    parser.add_argument(
        "--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="folder for runs and metrics"
    )
    parser.add_argument(
        "--data",
        type=Path,
        default=Path("datasets"),
        metavar="DIR",
        help="folder of data sets: scenes are rendered into it, inpainted records are expected in it",
    )
    return parser


if __name__ == "__main__":
    run_command(main)
