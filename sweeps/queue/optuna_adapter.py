"""The parts of Optuna that its public interface does not offer, each behind one function.

Checked with Optuna 5. tests/test_sweep_optuna_adapter.py fails when an Optuna release changes one of them.
"""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import optuna
import sqlalchemy
from optuna.storages import BaseStorage, RDBStorage
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState


@dataclass(frozen=True)
class TrialSummary:
    """A trial without its parameters, values and heartbeats, and with some of its user attributes only."""

    trial_id: int
    number: int
    state: TrialState
    user_attrs: dict[str, Any] = field(default_factory=dict)


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


def summarise_trials(storage: RDBStorage, study: int, attributes: Collection[str]) -> list[TrialSummary]:
    """Return all trials of a study, by number, with the user attributes of these names.

    Optuna reads trials with all that belongs to them: a second for a thousand, and workers wait for one
    another meanwhile.
    """
    query = sqlalchemy.text(
        "SELECT t.trial_id, t.number, t.state, a.key, a.value_json FROM trials t "
        "LEFT JOIN trial_user_attributes a ON a.trial_id = t.trial_id AND a.key IN :names "
        "WHERE t.study_id = :study ORDER BY t.number"
    ).bindparams(sqlalchemy.bindparam("names", list(attributes), expanding=True))
    trials: dict[int, TrialSummary] = {}
    with storage.engine.connect() as connection:
        for trial, number, state, key, text in connection.execute(query, {"study": study}):
            summary = trials.setdefault(trial, TrialSummary(trial, number, TrialState[state]))
            if key is not None:
                summary.user_attrs[key] = json.loads(text)
    return list(trials.values())


def read_parameters(storage: RDBStorage, study: int) -> dict[int, dict[str, float]]:
    """Return the parameters of each trial of a study as stored: the position of a categorical level."""
    query = (
        "SELECT p.trial_id, p.param_name, p.param_value FROM trial_params p "
        "JOIN trials t ON t.trial_id = p.trial_id WHERE t.study_id = :study"
    )
    parameters: dict[int, dict[str, float]] = {}
    with storage.engine.connect() as connection:
        for trial, name, value in connection.execute(sqlalchemy.text(query), {"study": study}):
            parameters.setdefault(trial, {})[name] = value
    return parameters


def waiting_trial_ids(storage: RDBStorage, study: int) -> set[int]:
    """Return the ids of the trials that wait to be claimed."""
    query = "SELECT trial_id FROM trials WHERE study_id = :study AND state = 'WAITING'"
    with storage.engine.connect() as connection:
        return {int(trial) for (trial,) in connection.execute(sqlalchemy.text(query), {"study": study})}


def resume_trial(study: Study, trial: int) -> optuna.Trial:
    """Return the running trial with this id, to report intermediate values to."""
    return optuna.Trial(study, trial)
