"""A finished study of the whole grid, written in one go, as a grid queue would leave it."""

import datetime

import numpy as np
from optuna.distributions import CategoricalDistribution, distribution_to_json
from optuna.storages._rdb import models
from optuna.trial import TrialState
from sqlalchemy.orm import Session

from sweeps.queue.grid_queue import GridQueue
from sweeps.queue.study_storage import RetryPolicy, StudyStorage
from sweeps.queue.trial_queue import JOB, SEED
from sweeps.trials.search_space import FACTORS, POINTS


def write_finished_study(storage: str, values: np.ndarray, name: str = "grid") -> GridQueue:
    """Write a study in which the first points are complete with `values` [N, 2]: MRE and milliseconds."""
    queue = GridQueue(StudyStorage(storage, RetryPolicy()), name, FACTORS)
    distributions = {factor: CategoricalDistribution(levels) for factor, levels in FACTORS.items()}
    first_start = datetime.datetime(2026, 1, 1)
    with Session(queue.storage.rdb.engine) as session:
        for number, (point, objectives) in enumerate(zip(POINTS, values, strict=False)):
            started = first_start + datetime.timedelta(seconds=5 * number)
            trial = models.TrialModel(
                study_id=queue.study_id,
                number=number,
                state=TrialState.COMPLETE,
                datetime_start=started,
                datetime_complete=started + datetime.timedelta(seconds=4),
            )
            trial.params = [
                models.TrialParamModel(
                    param_name=factor,
                    param_value=distributions[factor].to_internal_repr(level),
                    distribution_json=distribution_to_json(distributions[factor]),
                )
                for factor, level in point.levels.items()
            ]
            trial.values = [
                models.TrialValueModel(objective=objective, value=float(value), value_type="FINITE")
                for objective, value in enumerate(objectives)
            ]
            attributes = {JOB: f'"{number:04d}"', SEED: "0", "images_per_s": "300.0", "parameters": "1000000"}
            trial.user_attributes = [
                models.TrialUserAttributeModel(key=key, value_json=text) for key, text in attributes.items()
            ]
            session.add(trial)
        session.commit()
    return queue
