"""Run jobs of the grid as a study: queue them, start workers, wait until they are done."""

from collections.abc import Iterable, Sequence

from laesi_tf.cli.tensorflow_setup import load_tensorflow
from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.trial_queue import Job, TrialQueue
from sweeps.trials.search_space import Point
from sweeps.workers.process import run_worker_process
from sweeps.workers.worker_pool import run_worker_pool
from sweeps.workers.worker_settings import WorkerSettings


def open_grid_study(settings: WorkerSettings, jobs: Sequence[Job]) -> GridQueue:
    """Open the study's queue with `jobs` in it, and requeue what an earlier run left open.

    Raises InputError if its trials had another budget.
    """
    attributes = settings.budget.to_attributes()
    queue = settings.open_grid()
    queue.check_study_setting("budget", attributes)
    queue.storage.retry_while_offline(lambda: queue.enqueue(jobs))
    queue.storage.retry_while_offline(queue.requeue_missing)
    return queue


def run_study(settings: WorkerSettings, queue: TrialQueue, points: Iterable[Point], *, workers: int) -> None:
    """Run the trials of `queue`, those of `points`, in `workers` processes until none is left.

    Raises InputError, before any worker starts, if scenes or weights of the budget cannot be had.
    """
    if queue.storage.retry_while_offline(queue.is_finished):
        return
    load_tensorflow()
    from laesi_tf.synthesis import load_ranges
    from sweeps.trials.trial_runner import check_weights

    load_ranges(settings.budget.ranges)
    check_weights(settings.budget, points)
    run_worker_pool(run_worker_process, (settings,), workers=workers, queue=queue)
