"""Networks that a run starts from: random or pretrained backbones, or the whole network of an earlier run."""

from dataclasses import asdict
from pathlib import Path

import keras

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError
from laesi_tf.common.run_files import BEST_MODEL_FILE, EXPORTED_WEIGHTS_FILE
from laesi_tf.models import batch_norm
from laesi_tf.models.backbone import FROM_SCRATCH
from laesi_tf.models.saved_model import ModelSpec, build_network, load_run
from laesi_tf.training.config import TrainConfig


def initialise_network(config: TrainConfig, *, origin: str | None = None) -> tuple[keras.Model, str]:
    """Return a new network and the origin of its weights.

    With an `origin` the weights stay random: the caller is about to restore them. Batch normalisation is
    frozen if `config` says so. Two calls with the same seed give the same network. Raises InputError for
    weights that are missing or of another network.
    """
    keras.utils.set_random_seed(config.seed)
    source = Path(config.weights)
    continues_run = origin is None and source.is_dir()
    weights = FROM_SCRATCH if continues_run or origin is not None else config.weights
    built = build_network(ModelSpec.from_config(asdict(config)), weights=weights, precision=config.precision)
    copied_origin = _copy_weights(source, built.model, config) if continues_run else built.origin
    origin = origin or copied_origin
    if config.batch_norm == "frozen":
        if origin == FROM_SCRATCH:
            raise InputError("batch_norm = 'frozen' needs pretrained weights; choose 'recalibrated'")
        batch_norm.freeze(built.backbone or built.model)
    return built.model, origin


def _copy_weights(path: Path, model: keras.Model, config: TrainConfig) -> str:
    """Set the weights of `model` to those of the run in `path`; return their origin."""
    run = load_run(path)
    for key in ("task", "backbone", "alpha", "transform"):
        if getattr(run.spec, key) != getattr(config, key):
            raise InputError(
                f"weights = {str(path)!r} is a run with {key} = {getattr(run.spec, key)!r}; "
                f"it cannot start one with {key} = {getattr(config, key)!r}"
            )
    model.set_weights(run.model.get_weights())
    file = next(path / name for name in (EXPORTED_WEIGHTS_FILE, BEST_MODEL_FILE) if (path / name).is_file())
    return f"run {path.absolute().name}, sha256 {short_sha256(file)}"
