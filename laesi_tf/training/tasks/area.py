"""Task `area`: regress the leaf area in cm2."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from laesi_tf.common.metrics import median_relative_error, mre, p90_relative_error, relative_errors
from laesi_tf.training.tasks.base import Array, Arrays, Metrics, Task

if TYPE_CHECKING:
    import tensorflow as tf
    from matplotlib.figure import Figure


class AreaTask(Task):
    """Targets are float32 [3]: area in cm2, pixels per mm at the leaf, fraction of the image that is leaf.

    Unknown ones are NaN.
    """

    name = "area"
    title = "Leaf area"
    losses = ("huber", "l1", "mse")
    main_metric = "mre"
    higher_is_better = False
    needs_leaf = True
    loss_is_mean_over_images = True
    metric_labels: ClassVar = {
        "mre": "mean relative error of the area, MRE (%)",
        "median": "median relative error (%)",
        "p90": "90th percentile of the relative error (%)",
    }

    def make_target(self, sample: "Mapping[str, tf.Tensor]") -> "tf.Tensor":
        import tensorflow as tf

        # An empty mask is that of a photo without one: the fraction is unknown.
        fraction = tf.reduce_mean(tf.cast(sample["mask"], tf.float32))
        fraction = tf.where(fraction > 0, fraction, math.nan)
        return tf.stack([sample["area_cm2"], sample["px_per_mm"], fraction])

    def loss(self, output: "tf.Tensor", target: "tf.Tensor") -> "tf.Tensor":
        from laesi_tf.models.area_network import area_loss

        return area_loss(output, target, transform=self.config.transform, loss=self.loss_name)

    def sample_metrics(self, output: Array, target: Array) -> dict[str, Array]:
        from laesi_tf.models.area_network import to_area_cm2

        predicted, true = to_area_cm2(output[:, 0], self.config.transform), target[:, 0]
        return {"predicted": predicted, "true": true, "error": relative_errors(predicted, true)}

    def aggregate(self, arrays: Arrays) -> dict[str, float]:
        areas = arrays["predicted"], arrays["true"]
        return {
            "mre": mre(*areas),
            "median": median_relative_error(*areas),
            "p90": p90_relative_error(*areas),
        }

    def headline(self, metrics: Metrics, validation_name: str) -> str:
        return (
            f"On {validation_name} the area is off by {metrics['mre']:.1f} % on average; "
            f"half are within {metrics['median']:.1f} %, nine in ten within {metrics['p90']:.1f} %."
        )

    def summary(self, metrics: Metrics) -> str:
        return (
            f"MRE {metrics['mre']:.2f} %, median {metrics['median']:.2f} %, "
            f"90th percentile {metrics['p90']:.2f} %"
        )

    def caption(self, arrays: Mapping[str, float]) -> str:
        predicted, true = arrays["predicted"], arrays["true"]
        return f"{predicted:.1f} cm² for {true:.1f} cm²: {100 * (predicted / true - 1):+.1f} %"

    def charts(self, arrays: Arrays) -> "list[tuple[str, Figure]]":
        from laesi_tf.reporting.run_charts import plot_predicted_against_true

        return [("Predicted against true", plot_predicted_against_true(arrays["predicted"], arrays["true"]))]
