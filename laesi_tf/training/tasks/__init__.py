"""The tasks that a network can be trained for: one module each, registered here."""

from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks.area import make_area_task
from laesi_tf.training.tasks.base import Task
from laesi_tf.training.tasks.mask import make_mask_task


def make_task(config: TrainConfig) -> Task:
    """The task a configuration names, with its loss."""
    return make_area_task(config) if config.task == "area" else make_mask_task(config)
