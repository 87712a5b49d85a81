"""Paths and file names of the experiments' output."""

from pathlib import Path

DEFAULT_OUT = Path("runs/experiments")
SETTINGS, MIXTURE = "settings.json", "mixture.toml"
"""Settings of a folder of experiments; the training data of a job."""
MEASURED = "photos.json"
"""Metrics of a job on the photos; written last, so its presence says that the job is finished."""
