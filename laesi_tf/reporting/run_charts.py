"""Charts of a run: learning curves, and predicted against true areas."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure


def plot_learning_curves(history: Sequence[Mapping[str, float]]) -> Figure:
    """Loss and score against steps and against minutes."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    score = "val_mre" if "val_mre" in history[0] else "val_miou"
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    for column, (unit, key) in enumerate((("steps", "step"), ("minutes", "minutes"))):
        across = [row[key] for row in history]
        for name in ("train_loss", "val_loss"):
            axes[0, column].plot(across, [row[name] for row in history], ".-", label=name.replace("_", " "))
        axes[1, column].plot(across, [row[score] for row in history], ".-", color="tab:green")
        axes[1, column].set_xlabel(unit)
    axes[0, 0].set(ylabel="loss", yscale="log")
    axes[0, 0].legend()
    axes[1, 0].set_ylabel("MRE (%)" if score == "val_mre" else "mIoU")
    if score == "val_mre":
        axes[1, 0].set_yscale("log")
    return figure


def plot_predicted_against_true(found: Mapping[str, np.ndarray]) -> Figure:
    """Predicted against true area, and the signed relative error against the true area."""
    true, predicted = found["true"], found["predicted"]
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    ends = [min(true.min(), predicted.min()), max(true.max(), predicted.max())]
    left.plot(ends, ends, color="0.7")
    left.loglog(true, predicted, ".", markersize=4)
    left.set(xlabel="true area (cm²)", ylabel="predicted area (cm²)")
    error = 100.0 * (predicted - true) / true
    bias, spread = error.mean(), 1.96 * error.std()
    right.semilogx(true, error, ".", markersize=4)
    for height, style in ((bias, "-"), (bias - spread, "--"), (bias + spread, "--")):
        right.axhline(height, color="0.5", linestyle=style)
    right.set(xlabel="true area (cm²)", ylabel="relative error (%)")
    right.set_title(f"bias {bias:+.1f} %, 95 % within ±{spread:.1f} % of it", fontsize=10)
    return figure
