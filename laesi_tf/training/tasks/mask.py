"""Task `mask`: segment the leaf."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from laesi_tf.common.metrics import ious, pixel_errors
from laesi_tf.training.tasks.base import Array, Arrays, Metrics, Task

if TYPE_CHECKING:
    import tensorflow as tf


class MaskTask(Task):
    """Targets are masks, uint8 [H, W], 1 where the leaf is."""

    name = "mask"
    title = "Leaf mask"
    losses = ("bce_dice", "bce")
    main_metric = "miou"
    higher_is_better = True
    needs_masks = True
    loss_is_mean_over_images = True
    metric_labels: ClassVar = {
        "miou": "mean intersection over union, mIoU",
        "mpe": "mask pixel error, MPE",
    }

    def make_target(self, sample: "Mapping[str, tf.Tensor]") -> "tf.Tensor":
        return sample["mask"]

    def loss(self, output: "tf.Tensor", target: "tf.Tensor") -> "tf.Tensor":
        from laesi_tf.models.mask_network import mask_loss

        return mask_loss(output, target, loss=self.loss_name)

    def sample_metrics(self, output: Array, target: Array) -> dict[str, Array]:
        leaf = output[..., 0] > 0.5
        iou = ious(leaf, target)
        return {"iou": iou, "pixel_error": pixel_errors(leaf, target), "error": 1.0 - iou}

    def aggregate(self, arrays: Arrays) -> dict[str, float]:
        return {"miou": float(np.mean(arrays["iou"])), "mpe": float(np.nanmean(arrays["pixel_error"]))}

    def headline(self, metrics: Metrics, validation_name: str) -> str:
        return (
            f"On {validation_name} true and predicted leaf overlap by {metrics['miou']:.3f} "
            f"(1 is perfect), and the leaf's pixel count is off by {100 * metrics['mpe']:.1f} %."
        )

    def summary(self, metrics: Metrics) -> str:
        return f"mIoU {metrics['miou']:.4f}, MPE {metrics['mpe']:.4f}"

    def caption(self, arrays: Mapping[str, float]) -> str:
        return f"overlap (IoU) {arrays['iou']:.3f}; predicted magenta, true blue"

    def masks(self, output: Array, target: Array) -> tuple[Array, Array]:
        return output[..., 0] > 0.5, target > 0
