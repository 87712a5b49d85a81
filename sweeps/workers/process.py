"""The entry point of a worker process."""

from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from sweeps.queue.study_storage import quiet_optuna
from sweeps.workers import worker_pool
from sweeps.workers.worker import run_trials
from sweeps.workers.worker_settings import WorkerSettings


def run_worker_process(settings: WorkerSettings) -> None:
    """Run trials until none is left or the supervisor has exited; exit like a command."""
    worker_pool.install_signal_handlers()
    run_command(lambda _: _run_worker(settings))


def _run_worker(settings: WorkerSettings) -> None:
    # This worker's share of the cores.
    load_tensorflow(threads=settings.threads)
    quiet_optuna()
    from sweeps.trials.training_data import TrainingData
    from sweeps.trials.trial_runner import TrialRunner
    from sweeps.workers.objective import TrainingObjective

    runner = TrialRunner(settings.budget, TrainingData(settings.budget, threads=settings.threads))
    queue = settings.open_queue_patiently()
    objective = TrainingObjective(runner, queue, settings.folder)
    run_trials(queue, objective, should_continue=lambda: not worker_pool.supervisor_is_gone())
