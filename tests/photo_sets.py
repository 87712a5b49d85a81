"""A folder with two photos, their masks, and a manifest that a test writes."""

from collections.abc import Callable
from pathlib import Path

from green import disk, photo
from PIL import Image

WriteManifest = Callable[[str | bytes], Path]


def make_photo_set(root: Path) -> WriteManifest:
    """Save a.png (60 x 40) and b.png (40 x 40) with masks; return a function that writes the manifest."""
    folder = root / "set"
    for name, size in {"a": (40, 60), "b": (40, 40)}.items():
        (folder / "masks").mkdir(parents=True, exist_ok=True)
        Image.fromarray(photo(*size)).save(folder / f"{name}.png")
        Image.fromarray(disk(*size)).save(folder / "masks" / f"{name}.png")
    Image.fromarray(photo(40, 40)).save(root / "outside.png")

    def write_manifest(content: str | bytes) -> Path:
        path = folder / "manifest.csv"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write_manifest
