"""Record where a run comes from: versions of the code and of the packages, origin of its weights."""

import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

from laesi_tf.synthesis import SYNTHESIS_VERSION

_PACKAGES = ("laesi_tf", "tensorflow", "keras", "numpy", "opencv-contrib-python-headless")


def collect_provenance(weights_origin: str) -> dict[str, Any]:
    """Return the provenance table of a run's config.toml."""
    packages = {name: _package_version(name) for name in _PACKAGES}
    return {
        "weights_origin": weights_origin,
        "synthesis_version": SYNTHESIS_VERSION,
        "git_commit": _git_commit(),
        "python": platform.python_version(),
        "packages": {name: version for name, version in packages.items() if version},
    }


def _package_version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _git_commit() -> str:
    """Return the commit of this checkout, with "+changes" if its files differ; empty outside a checkout."""
    folder = Path(__file__).parents[1]

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # Fails where the package is installed inside another repository.
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return ""
