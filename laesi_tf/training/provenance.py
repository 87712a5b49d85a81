"""Where a run came from: versions of the code and of the packages."""

import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGES = ("laesi_tf", "tensorflow", "keras", "numpy", "opencv-contrib-python-headless")


def collect_provenance(origin: str) -> dict[str, Any]:
    packages = {name: _package_version(name) for name in _PACKAGES}
    return {
        "weights_origin": origin,
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
    """The commit this package is checked out at, "+changes" if its files differ; empty outside a checkout."""
    folder = Path(__file__).parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # not merely installed inside someone's repository
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return ""
