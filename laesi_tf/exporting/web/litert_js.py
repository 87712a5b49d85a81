"""LiteRT.js, which runs the measurement in a browser: fetched from npm once, checked, and kept beside this
module.

The standard library alone, as the wheel's build runs this file too. Twenty megabytes of WebAssembly are no
source and stay out of git; a wheel contains them.
"""

import base64
import hashlib
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).parent / "runtime"
"""Where the files are kept."""


class _Package(NamedTuple):
    name: str
    version: str
    sha512: str
    files: dict[str, str]
    """Our name of each member that is used."""


_WASM = [
    f"litert_wasm_{variant}.{suffix}"
    for variant in ("internal", "compat_internal")
    for suffix in ("js", "wasm")
]
"""With relaxed SIMD, as Chrome and Firefox have it, and without, as Safari needs."""
_PACKAGES = (
    _Package(
        "@litertjs/core",
        "2.5.3",
        "PlGmbMOq9WitX7FO0jhbdJw9GthatsyuCQXjTt/wJZo0FLaw48q4tz8IwqgqCIkviYGr9OFDL1kCnN4nzWoyJQ==",
        {"dist/index.js": "litert.js"} | {f"wasm/{name}": name for name in _WASM},
    ),
    _Package(
        "@litertjs/wasm-utils",
        "2.5.3",
        "4fJiw6tBQnIs+0jH/OQ16nYOiSl8/+zZnn5h2ul8aTKHi05sVqZW580Tmk78pC2kT39A9OYBVdFawteZ/sI1kQ==",
        {"dist/index.js": "wasm_utils.js"},
    ),
)
_REPLACED = b'"@litertjs/wasm-utils"', b'"./wasm_utils.js"'
"""A browser finds modules by their address alone."""


class FetchError(Exception):
    """LiteRT.js could not be fetched; the message says why and what helps."""


def list_files(folder: Path = FOLDER) -> list[Path]:
    """Return the files of LiteRT.js; an empty list where one is missing."""
    paths = [folder / name for package in _PACKAGES for name in package.files.values()]
    return paths if all(path.is_file() for path in paths) else []


def fetch(folder: Path = FOLDER) -> None:
    """Fetch LiteRT.js with npm into `folder`. Raises FetchError."""
    npm = shutil.which("npm")
    if npm is None:
        raise FetchError("npm is not installed; install Node.js, which contains it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as temporary:
            for package in _PACKAGES:
                archive = _pack(npm, package, Path(temporary))
                _extract(archive, package, folder)
    except OSError as error:
        raise FetchError(f"cannot write {folder}: {error.strerror}") from None


def _pack(npm: str, package: _Package, folder: Path) -> Path:
    """Download the archive of a package, of the version and content that are expected."""
    what = f"{package.name}@{package.version}"
    command = [npm, "pack", "--silent", what]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    archive = folder / done.stdout.strip().rpartition("\n")[2]
    if done.returncode or not archive.is_file():
        lines = done.stderr.strip().splitlines() or ["no archive was written"]
        raise FetchError(f"npm could not fetch {what}: {lines[0]}")
    digest = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
    if digest != package.sha512:
        raise FetchError(f"{what} is not what this version of laesi_tf was tested with: its checksum differs")
    return archive


def _extract(archive: Path, package: _Package, folder: Path) -> None:
    with tarfile.open(archive) as members:
        for member, name in package.files.items():
            file = members.extractfile(f"package/{member}")
            if file is None:
                raise FetchError(f"{package.name}@{package.version} has no file {member}")
            content = file.read()
            if name == "litert.js":
                content = content.replace(*_REPLACED)
            (folder / name).write_bytes(content)
