import base64
import re

import cv2
import numpy as np
import pytest

from laesi_tf.reporting import run_report
from laesi_tf.training.config import TrainConfig

AREA = {"mre": 4.2, "median": 3.1, "p90": 9.9, "n": 3, "weights_origin": "<none>", "images_per_s": 61.0}
MASK = {"miou": 0.912, "mpe": 0.05, "n": 3, "weights_origin": "none", "images_per_s": float("nan")}
HISTORY = [
    {"step": step, "minutes": step / 9, "train_loss": 1 / step, "val_loss": 2 / step, "val_mre": 90 / step}
    for step in (1, 2, 3)
]
FOUND = {"predicted": np.array([9.0, 20.0, 33.0]), "true": np.array([10.0, 20.0, 30.0])}


def pictures_of(page):
    return [
        cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
        for data in re.findall(r"data:image/jpeg;base64,([^']+)", page)
    ]


def grey(masks=None, **figures):
    return run_report.ValidationImage(np.full((48, 64, 3), 128, np.uint8), figures, masks)


def test_the_report_of_areas_stands_alone(tmp_path):
    pictures = [grey(predicted=20.0, true=20.0), grey(predicted=9.0, true=10.0)]
    run_report.write_report(tmp_path, TrainConfig(), AREA, HISTORY, FOUND, pictures)
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"https?://|src='(?!data:)|<link|<script", page)
    assert page.count("data:image/png") == 2
    assert "On fresh synthetic pictures the area is off by 4.2 % on average" in page
    assert "Real photos differ" in page
    assert "&lt;none&gt;" in page
    assert "9.0 cm² for 10.0 cm²: -10.0 %" in page
    assert page.index("+0.0 %") < page.index("Worst pictures") < page.index("-10.0 %")
    assert [shown.shape for shown in pictures_of(page)] == [(144, 192, 3)] * 2


def test_the_report_of_masks_draws_both_outlines(tmp_path):
    true, predicted = np.zeros((2, 48, 64), bool)
    true[8:40, 8:24], predicted[8:40, 40:56] = True, True
    history = [row | {"val_miou": 0.5} for row in HISTORY]
    for row in history:
        del row["val_mre"]
    run_report.write_report(
        tmp_path,
        TrainConfig(task="mask"),
        MASK,
        history,
        {},
        [grey((predicted, true), iou=0.0)] * 2,
        validated_on="photos",
    )
    page = (tmp_path / "report.html").read_text()
    assert "On photos true and predicted leaf overlap by 0.912" in page and "differ:" not in page
    assert "overlap (IoU) 0.000" in page
    assert page.count("data:image/png") == 1
    shown = pictures_of(page)[0]
    rows = shown[60:90].mean(axis=0)
    redness, blueness = rows[:, 0] - rows[:, 1], rows[:, 2] - rows[:, 0]
    assert set(np.flatnonzero(blueness > 60) // 3) <= {7, 8, 23, 24}  # the true mask's sides
    assert set(np.flatnonzero(redness > 60) // 3) <= {39, 40, 55, 56}
    assert blueness.max() > 60
    assert redness.max() > 60


@pytest.mark.parametrize(("count", "expected"), [(1, 0), (3, 2), (16, 16), (100, 16)])
def test_the_best_and_the_worst_are_shown_once(count, expected):
    errors = np.random.default_rng(count).permutation(count).astype(float)
    chosen = run_report.select_best_and_worst(errors)
    assert len(set(chosen)) == len(chosen) == expected
    shown = errors[chosen]
    half = expected // 2
    assert shown[:half].tolist() == sorted(errors)[:half]
    assert shown[half:].tolist() == sorted(errors)[count - half :] if half else True
