"""Write what an app maker needs: measured files of each precision, a golden photo and a page of how-to."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from laesi_tf.common.atomic_files import atomic_write, short_sha256, write_json, write_text
from laesi_tf.common.run_files import BEST_MODEL_FILE, EXPORTED_WEIGHTS_FILE, LITERT_SUFFIX
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.estimators.keras_networks import make_area_estimator, make_mask_estimator, make_sheet_reader
from laesi_tf.estimators.litert_estimator import load_litert_estimator
from laesi_tf.estimators.litert_file import read_litert_file, write_litert_file
from laesi_tf.estimators.ruling_estimator import RulingEstimator
from laesi_tf.exporting.litert import VARIANTS, build_graph, convert, describe
from laesi_tf.exporting.litert_check import (
    Answerer,
    FileScore,
    Picture,
    answer_with_estimator,
    answer_with_mask_file,
    answer_with_network,
    is_as_good,
    score_answers,
)
from laesi_tf.models.saved_model import Run


class Networks(NamedTuple):
    """The runs that are exported."""

    area: Run
    mask: Run
    ruling: Run


def export_litert(
    networks: Networks,
    out: Path,
    pictures: Sequence[Picture],
    *,
    calibration: Sequence[Picture],
    variants: Sequence[str],
) -> Iterator[FileScore]:
    """Write the files of each kind and precision in `variants` to the folder `out`.

    Yield the score of each kind's parent, then that of each file, on `pictures`.

    A file that is not as good as its parent is deleted. Int8 ranges come from `calibration`. Raises
    InputError.
    """
    origins = {task: name_run(run) for task, run in networks._asdict().items()}
    for kind, possible in VARIANTS.items():
        wanted = [variant for variant in possible if variant in variants]
        if not wanted:
            continue
        parent, answers = score_answers(f"{kind}, Keras", _answer_as_parent(kind, networks), pictures)
        yield parent
        graph = build_graph(kind, networks.mask, networks.ruling, networks.area)
        for variant in wanted:
            size = (networks.area if kind == "area" else networks.mask).spec.size
            images = [letterbox_image(picture.image, size)[0] for picture in calibration]
            path = out / f"laesi-{kind}-{variant}{LITERT_SUFFIX}"
            details = describe(kind, origins) | {"variant": variant}
            if kind != "photo":
                details |= {"input_size": list(size)}
            # Checked as a file, under another name until it has passed.
            with tempfile.TemporaryDirectory(dir=out) as folder:
                candidate = Path(folder) / path.name
                write_litert_file(candidate, convert(graph, variant, images), details)
                size_mb = candidate.stat().st_size / 1e6
                score, _ = score_answers(
                    path.name,
                    _answer_with_file(kind, candidate, size),
                    pictures,
                    size_mb=size_mb,
                    parent=answers,
                )
                if is_as_good(score, parent, count=len(pictures)):
                    candidate.replace(path)
                    yield score
                else:
                    path.unlink(missing_ok=True)
                    yield replace(score, is_kept=False)


def write_guide(out: Path, picture: Picture) -> None:
    """Write the how-to, and a golden photo with the answer of each file in `out`."""
    with atomic_write(out / "golden.png") as temporary:
        Image.fromarray(picture.image).save(temporary, format="PNG")
    expected: dict[str, Any] = {"true_area_cm2": picture.area_cm2}
    for path in sorted(out.glob(f"*{LITERT_SUFFIX}")):
        if read_litert_file(path).metadata["kind"] == "mask":
            continue
        measured = load_litert_estimator(path).measure(picture.image, picture.info)
        expected[path.name] = {
            "refusal": measured.refusal,
            "leaves": [
                {
                    "area_cm2": leaf.area_cm2,
                    "uncertainty_cm2": leaf.uncertainty_cm2,
                    "length_mm": leaf.length_mm,
                    "width_mm": leaf.width_mm,
                }
                for leaf in measured.leaves
            ],
        }
    write_json(out / "golden.json", expected)
    write_text(out / "README.md", Path(__file__).with_name("app_readme.md").read_text(encoding="utf-8"))


def _answer_as_parent(kind: str, networks: Networks) -> Answerer:
    """Return what the files of a kind are compared with: the estimator or network in Keras."""
    makers: dict[str, Callable[[], Answerer]] = {
        "photo": lambda: answer_with_estimator(
            RulingEstimator(
                make_mask_estimator(networks.mask.model, networks.mask.spec.size),
                make_sheet_reader(networks.ruling.model),
            )
        ),
        "area": lambda: answer_with_estimator(
            make_area_estimator(networks.area.model, networks.area.spec.size, networks.area.spec.transform)
        ),
        "mask": lambda: answer_with_network(networks.mask),
    }
    return makers[kind]()


def _answer_with_file(kind: str, path: Path, size: tuple[int, int]) -> Answerer:
    if kind == "mask":
        return answer_with_mask_file(read_litert_file(path).model, size)
    answer = answer_with_estimator(load_litert_estimator(path))
    # The first call prepares memory.
    answer(Picture(np.zeros((64, 64, 3), np.uint8), 1.0, None))
    return answer


def name_run(run: Run) -> str:
    """Return the name of a run and the hash of its weights, without the folders of this machine."""
    weights = run.path / EXPORTED_WEIGHTS_FILE
    if not weights.is_file():
        weights = run.path / BEST_MODEL_FILE
    return f"{run.path.name}, sha256 {short_sha256(weights)}"
