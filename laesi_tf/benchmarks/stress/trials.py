"""Measure every picture at every severity with every method, and keep each result as soon as it is there."""

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from laesi_tf.benchmarks.stress.nuisances import Nuisance
from laesi_tf.benchmarks.stress.sources import Source
from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.common.atomic_files import append_bytes, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.estimators.base import Estimator, PhotoInfo

_FAR_OFF = 0.1
"""An area farther off than this share should have been refused."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One picture at one severity, measured by one method."""

    nuisance: str
    step: int
    """Number of the severity; 0 is none."""
    set: str
    method: str
    picture: int
    true_cm2: float
    predicted_cm2: float | None
    uncertainty_cm2: float | None
    refusal: str | None

    @property
    def key(self) -> tuple[str, int, str, str, int]:
        """What no other trial has."""
        return self.nuisance, self.step, self.set, self.method, self.picture

    @property
    def error(self) -> float | None:
        """(predicted - true) / true; None where the picture was refused, or shows no leaf."""
        if self.predicted_cm2 is None or self.true_cm2 <= 0:
            return None
        return self.predicted_cm2 / self.true_cm2 - 1

    @property
    def is_silent_error(self) -> bool:
        """Whether an area was given that is far off."""
        return self.error is not None and abs(self.error) > _FAR_OFF


class TrialFile:
    """The trials of a run, a line each, which a stopped run continues."""

    def __init__(self, path: Path, settings: Mapping[str, Any], digests: Mapping[str, str]) -> None:
        """Open or begin a file.

        `digests` are those of what sets and methods stand for, by name; further ones may be added later.
        Raises InputError if the file was begun with other settings, or with something else of the same name.
        """
        self._path = path
        self.trials: dict[tuple[str, int, str, str, int], Trial] = {}
        first = json.dumps(settings, sort_keys=True)
        begun, *lines = _read_lines(path) or [""]
        if not begun:
            write_text(path, f"{first}\n")
        elif begun != first:
            raise InputError(f"{path} was begun with other settings ({begun}); name another --out")
        known: dict[str, str] = {}
        for line in lines:
            try:
                values = json.loads(line)
                if "digest" in values:
                    known[values["name"]] = values["digest"]
                    continue
                trial = Trial(**values)
            except (ValueError, TypeError):  # the last line of a run that was killed
                continue
            self.trials[trial.key] = trial
        if changed := [name for name, digest in digests.items() if known.get(name, digest) != digest]:
            raise InputError(f"{path} holds results of another {changed[0]!r}; name another --out")
        new = [{"name": name, "digest": value} for name, value in digests.items() if name not in known]
        # A run that was killed may have left half a line.
        end = "" if path.read_bytes().endswith(b"\n") else "\n"
        append_bytes(path, (end + "".join(f"{json.dumps(one)}\n" for one in new)).encode())

    def add(self, trials: Sequence[Trial]) -> None:
        """Add trials. Raises InputError where they cannot be written."""
        lines = "".join(f"{json.dumps(dataclasses.asdict(trial))}\n" for trial in trials)
        append_bytes(self._path, lines.encode())
        self.trials |= {trial.key: trial for trial in trials}


def _read_lines(path: Path) -> list[str]:
    """Return the lines of a file; none where there is no file yet. Raises InputError."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no file of trials ({error}); name another --out") from None


def run_trials(
    file: TrialFile,
    sources: Mapping[str, Source],
    nuisances: Sequence[Nuisance],
    estimators: Mapping[str, Estimator],
) -> list[Trial]:
    """Run the trials that `file` lacks and return all of them, those of other nuisances left out."""
    wanted = list(_list_pictures(sources, nuisances))
    calm: dict[tuple[str, str, int], Trial] = {}
    for name, nuisance, step, picture in progress_bar(wanted, desc="pictures", unit="picture"):
        keys = {method: (nuisance.name, step, name, method, picture) for method in estimators}
        missing = {method for method, key in keys.items() if key not in file.trials}
        if step == 0:
            # The picture as it is belongs to all nuisances and is measured once.
            known = {method for method in missing if (name, method, picture) in calm}
            file.add([dataclasses.replace(calm[name, m, picture], nuisance=nuisance.name) for m in known])
            missing -= known
        if missing:
            photo = sources[name].make(picture, nuisance, step)
            place = (nuisance.name, step, name)
            file.add([_measure(photo, estimators[m], place, m, picture) for m in estimators if m in missing])
        if step == 0:
            calm |= {(name, method, picture): file.trials[key] for method, key in keys.items()}
    return [file.trials[n.name, s, name, m, p] for name, n, s, p in wanted for m in estimators]


def measure_photo(estimator: Estimator, photo: StressPhoto) -> Any:
    """Measure a picture. Its scale is given; methods that read it from the photo do not use it."""
    return estimator.measure(photo.image, PhotoInfo(px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm))


def _list_pictures(
    sources: Mapping[str, Source], nuisances: Sequence[Nuisance]
) -> Iterator[tuple[str, Nuisance, int, int]]:
    for name, source in sources.items():
        for nuisance in nuisances:
            if source.has(nuisance):
                for step in range(len(nuisance.severities)):
                    yield from ((name, nuisance, step, picture) for picture in range(source.count))


def _measure(
    photo: StressPhoto, estimator: Estimator, place: tuple[str, int, str], method: str, picture: int
) -> Trial:
    measurement = measure_photo(estimator, photo)
    nuisance, step, name = place
    return Trial(
        nuisance=nuisance,
        step=step,
        set=name,
        method=method,
        picture=picture,
        true_cm2=photo.area_cm2,
        predicted_cm2=measurement.area_cm2,
        uncertainty_cm2=measurement.uncertainty_cm2,
        refusal=measurement.refusal,
    )
