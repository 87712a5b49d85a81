import base64
import re

import cv2
import numpy as np
import pytest

from laesi_tf.reporting.run_charts import plot_learning_curves, plot_predicted_against_true
from laesi_tf.reporting.run_report import RunReport, ValidationImage, write_report
from laesi_tf.training.run_summary import select_best_and_worst

METRICS = {"mre": 4.2, "n": 3, "weights_origin": "<none>", "images_per_s": float("nan"), "task": "area"}
HISTORY = [
    {"step": step, "minutes": step / 9, "train_loss": 1 / step, "val_loss": 2 / step, "val_mre": 90 / step}
    for step in (1, 2, 3)
]


def embedded_images(page):
    return [
        cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
        for data in re.findall(r"data:image/jpeg;base64,([^']+)", page)
    ]


def grey_image(caption="", masks=None):
    return ValidationImage(np.full((48, 64, 3), 128, np.uint8), caption, masks)


def written_page(folder, **changes):
    content = {
        "title": "Leaf area, run <mine>",
        "headline": "On scenes the area is off by 4.2 %.",
        "metrics": METRICS,
        "metric_labels": {"mre": "MRE (%)"},
        "history": HISTORY,
        "main_metric": "mre",
        "charts": [],
        "best": [],
        "worst": [],
        "config": {"size": (224, 224)},
    }
    write_report(folder, RunReport(**content | changes))
    return (folder / "report.html").read_text()


def test_the_report_is_one_self_contained_file(tmp_path):
    chart = plot_predicted_against_true(np.array([9.0, 20.0, 33.0]), np.array([10.0, 20.0, 30.0]))
    page = written_page(
        tmp_path, charts=[("Areas", chart)], best=[grey_image("good")], worst=[grey_image("bad")]
    )
    assert not re.search(r"https?://|src='(?!data:)|<link|<script", page)
    assert page.count("data:image/png") == 2
    assert "On scenes the area is off by 4.2 %." in page
    assert "run &lt;mine&gt;" in page and "&lt;none&gt;" in page
    assert "224 × 224" in page
    assert page.index("good") < page.index("Worst images") < page.index("bad")
    assert [image.shape for image in embedded_images(page)] == [(144, 192, 3)] * 2


def test_learning_curves_are_shown_once():
    figure = plot_learning_curves(HISTORY, "val_mre", "MRE (%)")
    lines = [line.get_ydata().tolist() for axes in figure.axes for line in axes.get_lines()]
    assert lines == [[row[name] for row in HISTORY] for name in ("train_loss", "val_loss", "val_mre")]
    figure.canvas.draw()  # the axis of minutes can be drawn


def test_the_report_of_masks_draws_both_outlines(tmp_path):
    true, predicted = np.zeros((2, 48, 64), bool)
    true[8:40, 8:24], predicted[8:40, 40:56] = True, True
    page = written_page(tmp_path, best=[grey_image(masks=(predicted, true))])
    shown = embedded_images(page)[0]
    rows = shown[60:90].mean(axis=0)
    redness, blueness = rows[:, 0] - rows[:, 1], rows[:, 2] - rows[:, 0]
    assert set(np.flatnonzero(blueness > 60) // 3) <= {7, 8, 23, 24}  # the true mask's sides
    assert set(np.flatnonzero(redness > 60) // 3) <= {39, 40, 55, 56}
    assert blueness.max() > 60
    assert redness.max() > 60


@pytest.mark.parametrize(("count", "expected"), [(1, 0), (3, 2), (16, 16), (100, 16)])
def test_the_best_and_the_worst_are_shown_once(count, expected):
    errors = np.random.default_rng(count).permutation(count).astype(float)
    chosen = select_best_and_worst(errors)
    assert len(set(chosen)) == len(chosen) == expected
    shown = errors[chosen]
    half = expected // 2
    assert shown[:half].tolist() == sorted(errors)[:half]
    assert shown[half:].tolist() == sorted(errors)[count - half :] if half else True
