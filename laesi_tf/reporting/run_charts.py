"""Charts of a run: learning curves, and predicted against true areas."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray


def plot_learning_curves(history: Sequence[Mapping[str, float]], metric: str, label: str) -> Figure:
    """Plot losses, and the column `metric` called `label`, against steps, with minutes along the top.

    Metrics that are percentages have a logarithmic axis.
    """
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    steps = [row["step"] for row in history]
    for name in ("train_loss", "val_loss"):
        left.plot(steps, [row[name] for row in history], ".-", label=name.replace("_", " "))
    left.set(ylabel="loss", yscale="log")
    left.legend()
    right.plot(steps, [row[metric] for row in history], ".-", color="tab:green")
    right.set(ylabel=label, yscale="log" if "%" in label else "linear")
    for axes in (left, right):
        axes.set_xlabel("steps")
        _add_minutes_axis(axes, steps, [row["minutes"] for row in history])
    return figure


def plot_predicted_against_true(predicted: NDArray[Any], true: NDArray[Any]) -> Figure:
    """Plot predicted against true areas, [N] in cm2, and the signed relative error against the true area."""
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    ends = [min(true.min(), predicted.min()), max(true.max(), predicted.max())]
    left.plot(ends, ends, color="0.7")
    left.loglog(true, predicted, ".", markersize=4)
    left.set(xlabel="true area (cm²)", ylabel="predicted area (cm²)")
    error = 100.0 * (predicted - true) / true
    bias, half_width = error.mean(), 1.96 * error.std()
    right.semilogx(true, error, ".", markersize=4)
    for height, style in ((bias, "-"), (bias - half_width, "--"), (bias + half_width, "--")):
        right.axhline(height, color="0.5", linestyle=style)
    right.set(xlabel="true area (cm²)", ylabel="relative error (%)")
    right.set_title(f"bias {bias:+.1f} %, 95 % within ±{half_width:.1f} % of it", fontsize=10)
    return figure


def _add_minutes_axis(axes: Any, steps: Sequence[float], minutes: Sequence[float]) -> None:
    """Label the top of `axes` with the minutes that had passed; steps and minutes start at 0 together."""
    steps, minutes = [0.0, *steps], [0.0, *minutes]
    if minutes[-1] <= 0:
        return
    pace = minutes[-1] / steps[-1]
    top = axes.secondary_xaxis(
        "top",
        functions=(
            lambda step: np.where(step > steps[-1], step * pace, np.interp(step, steps, minutes)),
            lambda minute: np.where(minute > minutes[-1], minute / pace, np.interp(minute, minutes, steps)),
        ),
    )
    top.set_xlabel("minutes")
