"""What differs between the tasks that a network is trained for."""

import abc
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from numpy.typing import NDArray

# Tasks are imported to check a command's flags: what needs TensorFlow or Matplotlib is imported where it is
# used.
if TYPE_CHECKING:
    import tensorflow as tf
    from matplotlib.figure import Figure

    from laesi_tf import synthesis
    from laesi_tf.training.config import TrainConfig

Array = NDArray[Any]
Arrays = Mapping[str, Array]
Metrics = Mapping[str, float]


class Task(abc.ABC):
    """How to train a network, evaluate it and report on it, for one configuration.

    The network is registered in `laesi_tf.models.saved_model` under the name of the task.

    A sample is a dict of tensors as `laesi_tf.data.synthetic` makes it. "Arrays" are what was computed for
    each image of a set, [N] by name.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    """Heading of the report."""
    losses: ClassVar[tuple[str, ...]]
    """Names of the losses; the first one is the default."""
    main_metric: ClassVar[str]
    """The metric that selects the best network."""
    higher_is_better: ClassVar[bool]
    needs_masks: ClassVar[bool] = False
    """Whether photos without a mask are left out of a mixture."""
    needs_leaf: ClassVar[bool] = False
    """Whether images without a leaf are left out."""
    min_side_px: ClassVar[int] = 32
    """Images have at least this many pixels on a side."""
    live_scenes_only: ClassVar[bool] = False
    """Whether only live scenes, neither augmented nor with several lighting passes, have its targets."""
    loss_is_mean_over_images: ClassVar[bool] = False
    """Whether the loss of a batch is the mean of those of its halves. Otherwise several devices exchange
    their outputs in every step, and each computes the loss of all of them."""
    has_backbone: ClassVar[bool] = True
    """Whether the network is a head on the MobileNetV3 that the configuration names."""
    metric_labels: ClassVar[Mapping[str, str]]
    """The metrics of `aggregate` with their names and units as a report shows them."""

    def __init__(self, config: "TrainConfig") -> None:
        self.config = config
        self.loss_name = self.losses[0] if config.loss == "auto" else config.loss

    def choose_ranges(self, ranges: "synthesis.Ranges") -> "synthesis.Ranges":
        """Return those of `ranges` that images of this task may have."""
        return ranges.without_empty_sheets() if self.needs_leaf else ranges

    def renderer(self) -> "Callable[..., dict[str, tf.Tensor]]":
        """Return the function that renders sample `index` of `seed`, with the arguments of `synthesise`."""
        from laesi_tf.synthesis import synthesise

        return synthesise

    @abc.abstractmethod
    def make_target(self, sample: "Mapping[str, tf.Tensor]") -> "tf.Tensor":
        """Return what the network shall predict for one sample."""

    @abc.abstractmethod
    def loss(self, output: "tf.Tensor", target: "tf.Tensor") -> "tf.Tensor":
        """Return the mean loss of a batch, a scalar."""

    @abc.abstractmethod
    def sample_metrics(self, output: Array, target: Array) -> dict[str, Array]:
        """Return arrays [B] for a batch; "error" ranks images from good to bad."""

    @abc.abstractmethod
    def aggregate(self, arrays: Arrays) -> dict[str, float]:
        """Return the metrics of a whole set from its arrays."""

    @abc.abstractmethod
    def headline(self, metrics: Metrics, validation_name: str) -> str:
        """Return the sentence that opens the report: what was reached on `validation_name`."""

    @abc.abstractmethod
    def summary(self, metrics: Metrics) -> str:
        """Return the metrics in one line, for a terminal."""

    @abc.abstractmethod
    def caption(self, arrays: Mapping[str, float]) -> str:
        """Return the caption of one validation image from its entries of the arrays."""

    def masks(self, output: Array, target: Array) -> tuple[Array, Array] | None:
        """Return the predicted and the true mask of one image, bool [H, W], for tasks that predict one."""
        return None

    def charts(self, arrays: Arrays) -> "list[tuple[str, Figure]]":
        """Return charts for the report, each with its heading."""
        return []

    def ranking_score(self, metrics: Metrics) -> float:
        """Return the main metric with the sign that makes higher better."""
        return metrics[self.main_metric] if self.higher_is_better else -metrics[self.main_metric]
