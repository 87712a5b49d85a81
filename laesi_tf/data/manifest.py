"""Read a manifest: a CSV file that lists photos of known leaf area.

Its header is `image,area_cm2` and optionally `visible_area_cm2`, `mask`, `px_per_mm`, `grid_mm`, `split`,
`subset` and `species`; other columns are ignored. Paths are relative to the CSV and must not leave its
folder.
"""

import csv
import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import TextIO

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import read_upright_size

MANIFEST_FILE = "manifest.csv"
"""Name of the manifest in a folder of samples."""


@dataclass(frozen=True, kw_only=True)
class Photo:
    """One photo of a manifest."""

    name: str
    """The image's path as the manifest writes it."""
    image: Path
    area_cm2: float
    visible_area_cm2: float | None = None
    """The part of the area that nothing covers on the photo, if the manifest says it."""
    mask: Path | None = None
    px_per_mm: float | None = None
    """Scale at the leaf's centroid."""
    grid_mm: float | None = None
    """Distance between the finest lines of the paper; None where the manifest does not say it."""
    split: str | None = None
    subset: str | None = None
    species: str | None = None

    @property
    def seen_cm2(self) -> float:
        """The area that can be measured on the photo: of a leaf that is covered in part, what is visible."""
        return self.visible_area_cm2 or self.area_cm2


def read_manifest(path: Path | str, *, split: str | None = None) -> list[Photo]:
    """Return the photos of the manifest at `path` in its order, or only those of `split`.

    Every row of every split is checked. A damaged image is not an error here: whoever decodes it reports it.
    Raises InputError that names the file and the line.
    """
    path = Path(path)
    try:
        # utf-8-sig: Excel writes a byte order mark before the first column's name.
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(_parse_rows(path, file))
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot read manifest {path}: {error.strerror}; name a CSV file") from None
    except UnicodeDecodeError:
        raise InputError(f"manifest {path} is not UTF-8 text; save it as 'CSV UTF-8'") from None
    except (csv.Error, ValueError) as error:
        raise InputError(f"manifest {path} is not a CSV file ({error}); save it as 'CSV UTF-8'") from None
    _require_distinct(path, rows)
    return _select_split(path, [photo for _, photo in rows], split)


def read_photo_sets(named: Sequence[Sequence[str]]) -> dict[str, list[Photo]]:
    """Return sets of photos by name, folder and split: each of `named` is a manifest and perhaps a split.

    Raises InputError, also for two sets of one name.
    """
    sets: dict[str, list[Photo]] = {}
    for manifest, *splits in named:
        if len(splits) > 1:
            raise InputError(f"--photos {manifest} takes one split; give --photos again for another")
        name = " ".join([Path(manifest).resolve().parent.name, *splits])
        if name in sets:
            raise InputError(f"two sets are called {name!r}; rename a folder")
        sets[name] = read_manifest(manifest, split=splits[0] if splits else None)
    return sets


def digest_photos(photos: Sequence[Photo]) -> str:
    """Return 16 letters that change with the photos, their masks and their labels."""
    digest = hashlib.sha256()
    for photo in photos:
        digest.update(repr((photo.seen_cm2, photo.px_per_mm, photo.grid_mm)).encode())
        for path in (photo.image, photo.mask):
            if path is not None and path.is_file():
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _parse_rows(path: Path, file: TextIO) -> Iterator[tuple[int, Photo]]:
    """Yield (line number, photo) for every row of the manifest that is not blank."""
    header = file.readline()
    # Where the comma is the decimal mark, Excel separates by semicolons.
    has_commas = ";" not in header or "," in header
    lines = itertools.chain([header], file)
    reader = csv.DictReader(lines, delimiter="," if has_commas else ";", skipinitialspace=True, strict=True)
    columns = [(name or "").strip() for name in reader.fieldnames or ()]
    for column in ("image", "area_cm2"):
        if columns.count(column) != 1:
            raise InputError(
                f"manifest {path} has no single column {column!r} in its first line; "
                "it must begin with a header such as image,area_cm2,mask"
            )
    reader.fieldnames = columns
    for row in reader:
        where = f"{path} line {reader.line_num}"
        # The cells beyond the header; blank ones are allowed, as in tables that Excel padded.
        if any(cell.strip() for cell in row.get(None) or ()):
            raise InputError(
                f"{where} has more cells than the header; write decimals with a point, "
                "or separate columns by semicolons"
            )
        cells = {key: (value or "").strip() for key, value in row.items() if isinstance(value, str | None)}
        if not has_commas:
            cells = {key: _use_decimal_point(key, value) for key, value in cells.items()}
        if any(cells.values()):
            yield reader.line_num, _parse_photo(path.parent, cells, where)


_NUMBER_COLUMNS = ("area_cm2", "visible_area_cm2", "px_per_mm", "grid_mm")


def _use_decimal_point(column: str, value: str) -> str:
    return value.replace(",", ".") if column in _NUMBER_COLUMNS else value


def _parse_photo(folder: Path, cells: Mapping[str, str], where: str) -> Photo:
    def parse_optional(column: str) -> float | None:
        return _parse_positive(cells[column], where, column) if cells.get(column) else None

    photo = Photo(
        name=cells["image"],
        image=_resolve_inside(folder, cells["image"], where, "image"),
        area_cm2=_parse_positive(cells["area_cm2"], where, "area_cm2"),
        visible_area_cm2=parse_optional("visible_area_cm2"),
        mask=_resolve_inside(folder, cells["mask"], where, "mask") if cells.get("mask") else None,
        px_per_mm=parse_optional("px_per_mm"),
        grid_mm=parse_optional("grid_mm"),
        split=cells.get("split") or None,
        subset=cells.get("subset") or None,
        species=cells.get("species") or None,
    )
    _require_same_size(photo, where)
    return photo


def _parse_positive(text: str, where: str, column: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{where}: {column} is {text!r}; it must be a number above 0")
    return value


def _resolve_inside(folder: Path, text: str, where: str, column: str) -> Path:
    """Return the file that `text` names below `folder`, after following links. Raises InputError."""
    if not text or "\0" in text:
        raise InputError(f"{where}: {column} is not a path; name a file relative to the manifest")
    given = PureWindowsPath(text)  # It accepts both kinds of slashes as separators.
    path = folder / given.as_posix()
    is_outside = given.is_absolute() or given.drive or given.root or ".." in given.parts
    if is_outside or not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(
            f"{where}: {column} {text!r} leaves the manifest's folder; put the file below {folder}"
        )
    return path


def _require_same_size(photo: Photo, where: str) -> None:
    if photo.mask is None:
        return
    try:
        image, mask = read_upright_size(photo.image), read_upright_size(photo.mask)
    except InputError:
        return  # A damaged image is reported and skipped when it is decoded, so that the other photos count.
    if image != mask:
        raise InputError(
            f"{where}: mask is {mask[1]} x {mask[0]} pixels but its image {image[1]} x {image[0]} "
            "(upright); give every mask its image's size"
        )


def _require_distinct(path: Path, rows: Sequence[tuple[int, Photo]]) -> None:
    first: dict[Path, int] = {}
    for line, photo in rows:
        earlier = first.setdefault(photo.image.resolve(), line)
        if earlier != line:
            raise InputError(
                f"{path} line {line}: image {photo.name!r} is in line {earlier} already; keep one of them"
            )


def _select_split(path: Path, photos: list[Photo], split: str | None) -> list[Photo]:
    if not photos:
        raise InputError(f"manifest {path} lists no photo; add a line for each")
    if split is None:
        return photos
    selected = [photo for photo in photos if photo.split == split]
    if not selected:
        known = ", ".join(sorted({photo.split for photo in photos if photo.split})) or "none"
        raise InputError(f"manifest {path} has no photo in split {split!r}; its splits: {known}")
    return selected
