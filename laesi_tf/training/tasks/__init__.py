"""The tasks that a network can be trained for: one module each, registered in TASKS."""

from typing import TYPE_CHECKING

from laesi_tf.training.tasks.area import AreaTask
from laesi_tf.training.tasks.base import Task
from laesi_tf.training.tasks.mask import MaskTask
from laesi_tf.training.tasks.ruling import RulingTask

if TYPE_CHECKING:
    from laesi_tf.training.config import TrainConfig

TASKS: dict[str, type[Task]] = {task.name: task for task in (AreaTask, MaskTask, RulingTask)}


def make_task(config: "TrainConfig") -> Task:
    """Return the task that a configuration names."""
    return TASKS[config.task](config)
