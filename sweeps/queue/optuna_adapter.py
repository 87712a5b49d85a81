"""The parts of Optuna that its public interface does not offer, each behind one function.

Checked with Optuna 5. tests/test_sweep_optuna_adapter.py fails when an Optuna release changes one of them.
"""

from collections.abc import Sequence

import optuna
import sqlalchemy
from optuna.storages import BaseStorage, RDBStorage
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState


def trial_id(trial: FrozenTrial | optuna.Trial) -> int:
    """Return the storage's id of a trial; its public number counts within a study only."""
    return int(trial._trial_id)


def study_id(storage: BaseStorage, name: str) -> int:
    """Return the storage's id of the study `name`."""
    return int(storage.get_study_id_from_name(name))


def send_heartbeat(storage: RDBStorage, trial: int) -> None:
    """Record that the worker of the trial with this id is alive."""
    storage.record_heartbeat(trial)


def stale_trial_ids(storage: RDBStorage, study: int) -> Sequence[int]:
    """Return the ids of running trials without a heartbeat within the storage's grace period."""
    return storage._get_stale_trial_ids(study)


def count_trials(storage: RDBStorage, study: int) -> dict[TrialState, int]:
    """Count the trials of a study in each state, without reading the trials themselves."""
    query = "SELECT state, COUNT(*) FROM trials WHERE study_id = :study GROUP BY state"
    with storage.engine.connect() as connection:
        rows = connection.execute(sqlalchemy.text(query), {"study": study})
        counts = {TrialState[state]: int(count) for state, count in rows}
    return {state: counts.get(state, 0) for state in TrialState}


def resume_trial(study: Study, trial: int) -> optuna.Trial:
    """Return the running trial with this id, to report intermediate values to."""
    return optuna.Trial(study, trial)
