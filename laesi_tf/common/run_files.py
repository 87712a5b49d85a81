"""Names of the files in a run directory."""

CONFIG_FILE, STATE_FILE, HISTORY_FILE = "config.toml", "state.npz", "history.csv"
BEST_MODEL_FILE, METRICS_FILE, REPORT_FILE, TENSORBOARD_FOLDER = (
    "best.keras",
    "metrics.json",
    "report.html",
    "tensorboard",
)
EXPORTED_WEIGHTS_FILE, RANGES_FILE = "weights.npz", "ranges.toml"
