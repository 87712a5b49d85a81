"""Write exported runs that measure with and without TensorFlow, as the package ships them, and check them."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import LITERT_SUFFIX
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.exporting.app_folder import Networks
from laesi_tf.exporting.float16 import check_export_folder, export_float16
from laesi_tf.exporting.litert_check import FileScore, Picture, answer_with_estimator, score_answers
from laesi_tf.exporting.run_networks import write_network
from laesi_tf.models.saved_model import load_run

_CHECKS = {"mask x ruling": ("mask", "ruling"), "area": ("area",)}
"""What measures photos, and its tasks."""
_MOST_PERCENT = 0.01
"""By so much areas in LiteRT may differ from those in Keras."""


def export_package(networks: Networks, out: Path) -> None:
    """Write the folders `area`, `mask` and `ruling` in `out`: float16 weights, and the network for LiteRT.

    A run that is there already, as the shipped ones in `laesi_tf/pretrained`, keeps its weights. Raises
    InputError.
    """
    folders = {task: out / task for task in networks._fields}
    for folder in folders.values():
        check_export_folder(folder)
    for task, run in networks._asdict().items():
        if not (folders[task].is_dir() and folders[task].samefile(run.path)):
            export_float16(run, folders[task])
        write_network(load_run(folders[task]))


def check_package(out: Path, pictures: Sequence[Picture]) -> Iterator[FileScore]:
    """Measure `pictures` with the folders in `out` in Keras and in LiteRT, and yield both scores.

    The files of networks that differ are deleted. Raises InputError if no picture can be compared.
    """
    for name, tasks in _CHECKS.items():
        runs = {"run" if task == "area" else f"{task}_run": out / task for task in tasks}
        in_keras, in_litert = (
            answer_with_estimator(load_estimator(**runs, in_keras=flag))  # type: ignore[arg-type]
            for flag in (True, False)
        )
        files = [file for task in tasks for file in (out / task).glob(f"*{LITERT_SUFFIX}")]
        parent, answers = score_answers(f"{name}, Keras", in_keras, pictures)
        yield parent
        if parent.refused == len(pictures):
            raise InputError(f"{name}: all {len(pictures)} pictures were refused; compare with others")
        size_mb = sum(file.stat().st_size for file in files) / 1e6
        score, others = score_answers(f"{name}, LiteRT", in_litert, pictures, size_mb=size_mb, parent=answers)
        are_refused_alike = all(
            (one.area_cm2 is None) == (other.area_cm2 is None)
            for one, other in itertools.zip_longest(answers, others)
        )
        if are_refused_alike and score.worst_difference <= _MOST_PERCENT:
            yield score
        else:
            for file in files:
                file.unlink()
            yield replace(score, is_kept=False)
