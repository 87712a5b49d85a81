"""Task `ruling`: say for each cell of a photo whether printed squares can be seen there, how fine they are
and which way they lie."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from laesi_tf.training.tasks.base import Array, Arrays, Metrics, Task

if TYPE_CHECKING:
    import tensorflow as tf

_RIGHT_WITHIN = 0.15
"""Difference of ln periods up to which a period is right: neighbouring wrong answers are a factor of 1.2 and
more away."""
_COUNTS = ("readable", "found", "period_right", "unreadable", "false_alarms", "hidden", "hidden_found")


class RulingTask(Task):
    """Targets are float32 [h, w, 5], the labels of each cell of 16 x 16 pixels.

    See `laesi_tf.synthesis.ruling_labels.RulingLabels`. Images are crops of scenes at any scale.
    """

    name = "ruling"
    title = "Ruling of the paper"
    losses = ("cross_entropy",)
    main_metric = "right"
    higher_is_better = True
    min_side_px = 64
    live_scenes_only = True
    has_backbone = False
    metric_labels: ClassVar = {
        "right": "cells answered right (%)",
        "found": "cells with visible squares that are found (%)",
        "period_right": "of these, with the right period (%)",
        "false_alarms": "cells without squares that are taken for ruled (%)",
        "hidden_found": "cells with finer lines than can be seen that are recognised (%)",
    }

    def renderer(self) -> "Callable[..., dict[str, tf.Tensor]]":
        from laesi_tf.synthesis import synthesise_ruling_crop

        return synthesise_ruling_crop

    def make_target(self, sample: "Mapping[str, tf.Tensor]") -> "tf.Tensor":
        return sample["ruling"]

    def loss(self, output: "tf.Tensor", target: "tf.Tensor") -> "tf.Tensor":
        import tensorflow as tf

        from laesi_tf.models.ruling_network import RulingTargets, ruling_loss

        return ruling_loss(output, RulingTargets(*tf.unstack(target, axis=-1)))

    def sample_metrics(self, output: Array, target: Array) -> dict[str, Array]:
        from laesi_tf.models.ruling_cells import LOG_STEP
        from laesi_tf.models.ruling_network import RulingTargets, split_heads, to_bin

        heads = {name: np.asarray(part) for name, part in split_heads(output).items()}
        truth = RulingTargets(*np.moveaxis(target, -1, 0))
        called = heads["readable"] > 0
        off = np.abs(heads["periods"].argmax(-1) - np.asarray(to_bin(truth.log_period))) * LOG_STEP
        readable, unreadable = truth.readable == 1, truth.readable == 0
        hidden = truth.finest_uncertain == 1
        cells = {
            "readable": readable,
            "found": readable & called,
            "period_right": readable & called & (off < _RIGHT_WITHIN),
            "unreadable": unreadable,
            "false_alarms": unreadable & called,
            "hidden": hidden,
            "hidden_found": hidden & (heads["finest_uncertain"] > 0),
        }
        counts = {name: mask.sum((1, 2)) for name, mask in cells.items()}
        return counts | {"error": 1 - _share_right(counts)}

    def aggregate(self, arrays: Arrays) -> dict[str, float]:
        sums = {name: np.asarray(arrays[name].sum()) for name in _COUNTS}
        return {
            "right": 100 * float(_share_right(sums)),
            "found": _percent(sums["found"], sums["readable"]),
            "period_right": _percent(sums["period_right"], sums["found"]),
            "false_alarms": _percent(sums["false_alarms"], sums["unreadable"]),
            "hidden_found": _percent(sums["hidden_found"], sums["hidden"]),
        }

    def headline(self, metrics: Metrics, validation_name: str) -> str:
        return (
            f"On {validation_name} {metrics['right']:.1f} % of the cells are answered right: "
            f"{metrics['found']:.1f} % of the visible squares are found, {metrics['period_right']:.1f} % of "
            f"these with the right period; {metrics['false_alarms']:.1f} % of the other cells are taken for "
            "ruled."
        )

    def summary(self, metrics: Metrics) -> str:
        return (
            f"cells right {metrics['right']:.2f} %, found {metrics['found']:.1f} %, "
            f"period {metrics['period_right']:.1f} %, false alarms {metrics['false_alarms']:.2f} %"
        )

    def caption(self, arrays: Mapping[str, float]) -> str:
        return (
            f"{arrays['found']:.0f} of {arrays['readable']:.0f} ruled cells found, "
            f"{arrays['period_right']:.0f} with the right period; {arrays['false_alarms']:.0f} of "
            f"{arrays['unreadable']:.0f} others called ruled"
        )


def _share_right(counts: Mapping[str, Any]) -> Any:
    """Return the share of cells with a label that are answered right; 1 where no cell has one."""
    asked = counts["readable"] + counts["unreadable"]
    right = counts["period_right"] + counts["unreadable"] - counts["false_alarms"]
    return np.where(asked > 0, right / np.maximum(asked, 1), 1.0)


def _percent(part: Array, whole: Array) -> float:
    return 100 * float(part / np.maximum(whole, 1))
