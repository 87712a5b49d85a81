"""Names of the files in a run directory, and of what is exported from one."""

from pathlib import Path

from laesi_tf.common.errors import InputError

PRETRAINED = Path(__file__).parents[1] / "pretrained"
"""Folders `area`, `mask` and `ruling`: the exported runs that come with the package."""

CONFIG_FILE = "config.toml"
"""The configuration and where the run comes from."""
RANGES_FILE = "ranges.toml"
"""A copy of the ranges, if they came from a file."""
MIXTURE_FILE = "mixture.toml"
"""A copy of the mixture, if there was one."""
STATE_FILE = "state.npz"
"""Variables and progress that a stopped run continues from."""
HISTORY_FILE = "history.csv"
"""One row per validation."""
TENSORBOARD_FOLDER = "tensorboard"
"""The same for TensorBoard."""
BEST_MODEL_FILE = "best.keras"
"""The network with the best validation score."""
EXPORTED_WEIGHTS_FILE = "weights.npz"
"""In its place in an exported run: the same network's variables as float16."""
LITERT_SUFFIX = ".tflite"
"""Of a graph that LiteRT runs."""
NETWORK_FILE = f"network{LITERT_SUFFIX}"
"""The same network as LiteRT runs it, in an exported run: measuring with it needs no TensorFlow."""
READING_FILE = f"reading{LITERT_SUFFIX}"
"""Beside that of a ruling network: all that follows from its answers."""
METRICS_FILE = "metrics.json"
"""Metrics of that network; written last: where it exists, the run is finished."""
REPORT_FILE = "report.html"
"""All of it for reading."""


def require_run(run: Path | str) -> None:
    """Raise InputError unless the folder `run` holds a run."""
    if not (Path(run) / CONFIG_FILE).is_file():
        raise InputError(f"no run in {run}: {CONFIG_FILE} is missing; name a folder that train wrote")


def needs_tensorflow(model: Path | str) -> bool:
    """Return whether a model, a run directory, a LiteRT file or the name of a method, measures with
    TensorFlow."""
    return Path(model).is_dir() and not (Path(model) / NETWORK_FILE).is_file()
