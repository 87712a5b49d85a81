"""Paths and file names of the experiments' output."""

from pathlib import Path

# isort: split


DEFAULT_OUT = Path("runs/experiments")


SETTINGS, MEASURED = "settings.json", "photos.json"
"""What a folder of experiments was made with; what a trial's model makes of the photos, which ends it."""
MIXTURE = "mixture.toml"
