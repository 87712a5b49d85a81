"""Worth against cost of every component of a scene.

A network is trained on scenes without one component (or group of them), and on the barest scenes with that
alone; both are compared, seed by seed, with networks trained on all components and on none. Errors are those
on photographs, where components are meant to help: those of the area and ruling estimators, and of the mask
network alone, since refinement hides what a network has learned.
"""

import dataclasses
import hashlib
import json
import re
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import keras
import numpy as np

from laesi_tf.benchmarks.timing import MedianIqr
from laesi_tf.common.atomic_files import read_json, write_json, write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.manifest import Photo
from laesi_tf.estimators.base import Estimator
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.estimators.keras_networks import MaskOnlyEstimator, load_run_of
from laesi_tf.evaluation.photo_scores import score_photos, summarise
from laesi_tf.synthesis import Ranges, load_ranges
from laesi_tf.synthesis.ranges_toml import ranges_to_toml
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.loop import fit

ALL, BARE = "all components", "no component"
_RANGES_FILE, _NETWORKS_FILE = "scene.toml", "networks.json"

COLUMNS = (
    *("task", "component", "change", "seeds", "set", "metric", "value", "difference", "low", "high", "us"),
)
"""Columns of ablation.csv."""
Scores = Mapping[str, Mapping[str, float | int | None]]
"""Metrics of one network by set of photos and name."""
Row = dict[str, Any]
"""One component, changed one way, for one task, set and metric, by COLUMNS."""

_METRICS = {"area": ("mre",), "mask": ("mpe", "miou"), "ruling": ("scale_median", "refused_share")}
"""What the photos say about a network of each task: percent; two fractions; percent and a fraction."""


def _load_mask_only(path: Path) -> MaskOnlyEstimator:
    run = load_run_of("mask", path)
    return MaskOnlyEstimator(run.model, run.spec.size)


_ESTIMATORS: Mapping[str, Callable[[Path], Estimator]] = {
    "area": lambda run: load_estimator(run),
    "mask": _load_mask_only,
    "ruling": lambda run: load_estimator(ruling_run=run),
}


@dataclass(frozen=True)
class Variant:
    """Scenes with some components left out."""

    component: str
    """The component or group that is removed or alone; ALL or BARE for the two references."""
    change: str
    """`without`, `only`, or empty for the references."""
    ranges: Ranges

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return f"{self.change}-{self.component}".strip("-").replace(" ", "-")

    @property
    def digest(self) -> str:
        """What its scenes are, which distinguishes groups of one name with other members."""
        return hashlib.sha256(ranges_to_toml(self.ranges).encode()).hexdigest()[:12]

    @property
    def reference(self) -> str:
        """What it is compared with."""
        return ALL if self.change == "without" else BARE


def read_groups(ranges: str, arguments: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Return the components that change together, by the group's name; without `arguments`, each on its own.

    An argument is a component, or `NAME=COMPONENT+COMPONENT...`. Raises InputError for a component that the
    ranges lack. Empty sheets stay as they are: they are no part of what an image looks like.
    """
    known = _list_components(load_ranges(ranges))
    groups: dict[str, tuple[str, ...]] = {}
    for argument in arguments or known:
        name, is_group, members = argument.rpartition("=")
        name = name if is_group else argument
        if not re.fullmatch(r"[\w-]+", name) or name in groups:
            raise InputError(f"{argument!r}: a group needs a name of its own, of letters, digits, _ and -")
        groups[name] = tuple(members.split("+"))
    for component in (component for members in groups.values() for component in members):
        if component not in known:
            raise InputError(
                f"scenes of {ranges} have no component {component!r}; they have {', '.join(known)}"
            )
    return groups


def list_variants(ranges: str, groups: Mapping[str, Sequence[str]]) -> list[Variant]:
    """Return the variants of a preset or file: all, none, and each group of components removed and alone."""
    base = load_ranges(ranges)
    known = _list_components(base)

    def leave_out(names: Sequence[str]) -> Ranges:
        return dataclasses.replace(base, without=base.without | set(names))

    variants = [Variant(ALL, "", base), Variant(BARE, "", leave_out(known))]
    for name, members in groups.items():
        variants.append(Variant(name, "without", leave_out(members)))
        variants.append(Variant(name, "only", leave_out([one for one in known if one not in members])))
    return variants


def _list_components(ranges: Ranges) -> list[str]:
    return [name for name in ranges.list_enabled_components() if name != "empty_sheet"]


@dataclass(frozen=True, kw_only=True)
class AblationRunner:
    """Trains and measures the variants in the folder `out`; what is there already is not repeated.

    The file networks.json is all that is needed to continue: of the networks themselves, which are as many as
    they are poor, only their errors are kept.
    """

    out: Path
    config: TrainConfig
    """The recipe; task, seed and ranges are replaced."""
    sets: Mapping[str, Sequence[Photo]]

    settings: Mapping[str, Any]
    """What all of its results depend on."""

    def read_networks(self) -> dict[str, Scores]:
        """Return the scores of the networks so far. Raises InputError if they are of other settings."""
        path = self.out / _NETWORKS_FILE
        if not path.is_file():
            return {}
        content = read_json(path)
        if content["settings"] != json.loads(json.dumps(self.settings)):
            raise InputError(f"{self.out} holds an ablation with other settings; name another --out")
        networks: dict[str, Scores] = content["networks"]
        return networks

    def run(self, task: str, variant: Variant, seed: int) -> Scores:
        """Return the metrics of one network by set. Raises InputError; a stopped training continues."""
        networks = self.read_networks()
        name = f"{task}/{variant.folder}/{variant.digest}/seed{seed}"
        if name not in networks:
            folder = self.out / name
            scene = folder.parent / _RANGES_FILE
            write_text(scene, ranges_to_toml(variant.ranges))
            config = dataclasses.replace(self.config, task=task, seed=seed, ranges=str(scene.resolve()))
            fit(config, folder, show_progress=False)
            estimator = _ESTIMATORS[task](folder)
            summaries = {key: summarise(score_photos(estimator, photos)) for key, photos in self.sets.items()}
            networks[name] = {
                key: {metric: summary[metric] for metric in _METRICS[task]}
                for key, summary in summaries.items()
            }
            write_json(self.out / _NETWORKS_FILE, {"settings": self.settings, "networks": networks})
            shutil.rmtree(folder)
            # Dozens of networks with their graphs would fill the memory.
            keras.utils.clear_session()
        return networks[name]


def require_labels(tasks: Sequence[str], sets: Mapping[str, Sequence[Photo]]) -> None:
    """Raise InputError for photos that say nothing about a network of one of `tasks`."""
    for photo in (photo for photos in sets.values() for photo in photos):
        if "mask" in tasks and photo.mask is None:
            raise InputError(f"photo {photo.name} needs a mask for task mask")
        if "ruling" in tasks and photo.px_per_mm is None:
            raise InputError(f"photo {photo.name} needs px_per_mm for task ruling")


def run_ablation(
    runner: AblationRunner,
    tasks: Sequence[str],
    variants: Sequence[Variant],
    seeds: Sequence[int],
    measure_costs: Callable[[], Mapping[str, MedianIqr]],
) -> list[Row]:
    """Train and measure all of it, seed by seed, and return the rows.

    `measure_costs` measures the components, in microseconds, once all networks are there.
    """
    jobs = [(task, variant, seed) for seed in seeds for task in tasks for variant in variants]
    scores: dict[tuple[str, str], list[Any]] = defaultdict(list)
    for task, variant, seed in progress_bar(jobs, desc="networks", unit="network"):
        scores[task, variant.folder].append(runner.run(task, variant, seed))
    costs = measure_costs()
    return [row for task in tasks for row in _compare(task, variants, scores, runner.sets, costs)]


def _compare(
    task: str,
    variants: Sequence[Variant],
    scores: Mapping[tuple[str, str], Sequence[Any]],
    sets: Mapping[str, Any],
    costs: Mapping[str, MedianIqr],
) -> Iterator[Row]:
    references = {variant.component: variant.folder for variant in variants if not variant.change}
    for variant in variants:
        for name in sets:
            for metric in _METRICS[task]:
                own = _values(scores[task, variant.folder], name, metric)
                reference = _values(scores[task, references[variant.reference]], name, metric)
                low, high = interval_of_mean(own - reference)
                cost = costs.get(variant.component)
                yield {
                    "task": task,
                    "component": variant.component,
                    "change": variant.change,
                    "seeds": len(own),
                    "set": name,
                    "metric": metric,
                    "value": float(own.mean()),
                    "difference": float((own - reference).mean()) if variant.change else None,
                    "low": low if variant.change else None,
                    "high": high if variant.change else None,
                    "us": None if cost is None else cost.median,
                }


def interval_of_mean(differences: np.ndarray) -> tuple[float | None, float | None]:
    """Return the 95 % interval of the mean of paired `differences` [n] by Student's t; None for n = 1."""
    if len(differences) < 2:
        return None, None
    from scipy import stats

    half = stats.t.ppf(0.975, len(differences) - 1) * differences.std(ddof=1) / np.sqrt(len(differences))
    return float(differences.mean() - half), float(differences.mean() + half)


def _values(scores: Sequence[Any], name: str, metric: str) -> np.ndarray:
    """Return a metric by seed; a network whose photos were all refused has none: NaN."""
    return np.array([np.nan if one[name][metric] is None else one[name][metric] for one in scores], float)
