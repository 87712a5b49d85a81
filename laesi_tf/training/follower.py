"""Train with a chief in another process: the same steps on another part of every batch."""

from laesi_tf.common.interrupts import defer_interrupt
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.device_synthesis import AUTO
from laesi_tf.training.input_pipeline import InputPipeline
from laesi_tf.training.loop import STOPPING, TrainingInterrupted, notify
from laesi_tf.training.replicas import Replicas, Start, WorkerLost
from laesi_tf.training.replicated_trainer import make_trainer
from laesi_tf.training.trainer import BatchStream, train_steps

_ORIGIN = "the chief"


def follow(
    config: TrainConfig,
    replicas: Replicas,
    *,
    train: BatchStream | None = None,
    data_service: str = "",
    synthesis_device: str = AUTO,
    show_progress: bool = True,
) -> int:
    """Train what `config` says until the chief is finished; return the number of steps done.

    The chief, in another process, calls `fit` with the same configuration. It sends its variables and its
    step first, so nothing is read from the run directory here, and nothing is written. `train` replaces the
    live scenes as in `fit`. Raises InputError and its kinds as `fit` does.
    """
    if replicas.share_start(Start.TRAIN, config) is Start.FINISHED:
        return 0
    if train is None:
        pipeline = InputPipeline(
            config, data_service=data_service, synthesis_device=synthesis_device, replicas=replicas
        )
    parts = pipeline.training_batches if train is None else replicas.take_part(train)
    first = done = 0
    try:
        trainer, _ = make_trainer(config, replicas, origin=_ORIGIN)
        replicas.share_variables(trainer.variables)
        first, is_finished = replicas.share_progress(0, is_finished=False)
        if is_finished:
            return 0
        done = first
        with defer_interrupt(lambda: notify(STOPPING, show=show_progress)) as stop_requested:
            for step in train_steps(trainer, parts(first * config.batch_size), steps_done=first):
                done = step.number
                is_finished, is_stopped = replicas.agree(is_finished=False, is_stopped=stop_requested())
                if is_finished:
                    break
                if is_stopped:
                    raise KeyboardInterrupt
    except KeyboardInterrupt:
        raise TrainingInterrupted(f"stopped at step {done}; the chief saves the run") from None
    except WorkerLost as error:
        raise WorkerLost(
            f"{error} after step {done}; start all workers again with the same commands: the run continues "
            "from the chief's last checkpoint"
        ) from error
    return done - first
