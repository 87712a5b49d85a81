"""Show the scenes that --ranges make, before training on them.

scenes.png shows different leaves (with --photos beside real ones), components.png one scene with each
component added in turn, passes.png leaves in different light, masks.png outlines and labels.
"""

import argparse
import dataclasses
import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from laesi_tf.cli import parser, progress, run
from laesi_tf.data.ahead import read_ahead
from laesi_tf.data.decoding import decode
from laesi_tf.data.fitting import fit
from laesi_tf.data.photos import Photo, read_manifest
from laesi_tf.errors import InputError
from laesi_tf.files import require_writable, write_json
from laesi_tf.overlay import FOUND, captioned, outlined, printable, sheet, write_png
from laesi_tf.synthesis import COMPONENTS, Ranges, load_ranges, synthesise
from laesi_tf.synthesis.editing import as_toml, every_component

_COLUMNS = 6
_LEAVES, _PASSES = 6, 4
_CANDIDATES = 24


@dataclass(frozen=True)
class Picture:
    """One picture `image` uint8 [H, W, 3], its `mask` uint8 [H, W] 0/1, and `label`: numbers by name."""

    image: np.ndarray
    mask: np.ndarray
    label: dict[str, float]


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for unknown ranges, a bad manifest or a folder it cannot write."""
    options = _parser().parse_args(arguments)
    ranges = load_ranges(options.ranges)
    if options.print_ranges:
        _print_ranges(ranges, options.json)
        return
    photos = read_manifest(options.photos) if options.photos else []
    for path in (options.out / "scenes.png", options.json):
        if path is not None:
            require_writable(path)
    shown = scenes(ranges, seed=options.seed, count=options.count, size=options.size)
    sheets = {
        "scenes.png": [*_captioned_photos(photos[:_COLUMNS], options.size), *_captioned_scenes(shown)],
        "components.png": components(ranges, seed=options.seed, size=options.size),
        "passes.png": passes(ranges, seed=options.seed, size=options.size),
        "masks.png": _captioned_masks(shown),
    }
    columns = {"passes.png": _PASSES}
    for name, tiles in sheets.items():
        write_png(options.out / name, sheet(tiles, columns=columns.get(name, _COLUMNS)))
    files = [str(options.out / name) for name in sheets]
    if options.json is not None:
        write_json(options.json, {"files": files, "scenes": [picture.label for picture in shown]})
    print("\n".join(files))


def _print_ranges(ranges: Ranges, figures: Path | None) -> None:
    text = as_toml(ranges)
    if figures is not None:
        write_json(figures, tomllib.loads(text))
    print(text, end="")


def scenes(ranges: Ranges, *, seed: int, count: int, size: int) -> list[Picture]:
    """`count` different leaves, `size` pixels a side."""
    singly = ranges.with_passes(1)
    return [_picture(singly, seed, index, size) for index in progress(range(count), desc="scenes")]


def components(ranges: Ranges, *, seed: int, size: int) -> list[np.ndarray]:
    """One scene [H, W, 3], captioned: leaf and sheet alone, then with each component that `ranges` allow.

    The scene is the first in which every component can be seen, or of some the one that shows most.
    """
    names = [name for name in _VISIBLE_ORDER if ranges.has(name)]
    telling = _telling(ranges)
    best: list[np.ndarray] = []
    most = -1
    for index in progress(range(_CANDIDATES), desc="a scene that shows every component"):
        stages = [_picture(_only(telling, names[:n]), seed, index, size).image for n in range(len(names) + 1)]
        seen = sum(_differ(before, after) for before, after in itertools.pairwise(stages))
        if seen > most:
            best, most = stages, seen
        if most == len(names):
            break
    captions = ["leaf and sheet", *(f"+ {name.replace('_', ' ')}" for name in names)]
    return [captioned(image, [caption]) for image, caption in zip(best, captions, strict=True)]


def passes(ranges: Ranges, *, seed: int, size: int) -> list[np.ndarray]:
    """Leaves in rows, each under its lighting passes: captioned pictures [H, W, 3]."""
    lit = ranges.with_passes(_PASSES)
    shown = [_picture(lit, seed, i, size) for i in progress(range(_LEAVES * _PASSES), desc="passes")]
    return [
        captioned(picture.image, [f"leaf {i // _PASSES + 1}, light {i % _PASSES + 1}"])
        for i, picture in enumerate(shown)
    ]


# Relief before undulation: height that no light falls on cannot be seen.
_VISIBLE_ORDER = tuple(
    name
    for component in COMPONENTS
    if component != "undulation"
    for name in ((component, "undulation") if component == "relief" else (component,))
)


def _telling(ranges: Ranges) -> Ranges:
    """`ranges` with every component present, strong, and within the frame."""
    full = every_component(ranges.with_passes(1))
    return dataclasses.replace(
        full,
        camera=dataclasses.replace(full.camera, fill=(0.4, 0.45), blur_mm=(0.2, 0.25), noise=(0.02, 0.035)),
        props=dataclasses.replace(full.props, gap_mm=(2, 5), fragment_mm=(20, 40), handwriting_mm=(20, 34)),
        paper=dataclasses.replace(full.paper, left=(5, 25), top=(5, 25), crease_depth=(0.1, 0.14)),
        surface=dataclasses.replace(full.surface, undulation=(0.7, 1.0), spot_threshold=(0.45, 0.55)),
        light=dataclasses.replace(full.light, relief=(0.6, 0.9), strength=(0.4, 0.6), cast_strength=0.2),
    )


def _only(ranges: Ranges, names: Sequence[str]) -> Ranges:
    return dataclasses.replace(ranges, without=frozenset(COMPONENTS) - frozenset(names))


def _differ(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether an eye can tell two pictures [H, W, 3] apart: 3 of 256 levels in 0.2 % of the pixels."""
    change = np.abs(before.astype(np.int16) - after).max(axis=-1)
    return bool(np.mean(change >= 3) > 0.002)


def _picture(ranges: Ranges, seed: int, index: int, size: int) -> Picture:
    # Called eagerly: tracing a graph takes as long as two dozen pictures.
    made = synthesise(seed, size=(size, size), ranges=ranges, index=index)
    label = {name: made[name].numpy().item() for name in ("index", "area_cm2", "px_per_mm", "tilt_deg")}
    return Picture(made["image"].numpy(), made["mask"].numpy(), label)


def _captioned_scenes(shown: Sequence[Picture]) -> list[np.ndarray]:
    return [captioned(picture.image, [f"scene {picture.label['index']}"]) for picture in shown]


def _captioned_masks(shown: Sequence[Picture]) -> list[np.ndarray]:
    tiles = []
    for picture in shown:
        lines = [(outline, FOUND) for outline in _outlines(picture.mask)]
        caption = "{area_cm2:.2f} cm², {px_per_mm:.2f} px/mm, tilt {tilt_deg:.0f}°".format_map(picture.label)
        tiles.append(captioned(outlined(picture.image, lines, side=len(picture.image)), [caption]))
    return tiles


def _outlines(mask: np.ndarray) -> list[np.ndarray]:
    """Contours [N, 2] of `mask` [H, W], those of its holes too."""
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [contour[:, 0] for contour in contours]


def _captioned_photos(photos: Sequence[Photo], size: int) -> list[np.ndarray]:
    """Real photos at the scenes' size; one that cannot be read is a blank tile that says so."""
    tiles = []
    for photo, image in read_ahead(lambda photo: decode(photo.image), photos):
        name = printable(Path(photo.name).name)
        if isinstance(image, InputError):
            tiles.append(captioned(np.full((size, size, 3), 230, np.uint8), [f"cannot be read: {name}"]))
        else:
            tiles.append(captioned(fit(image, (size, size))[0], [f"photo {name}"]))
    return tiles


def _parser() -> argparse.ArgumentParser:
    made = parser("preview", __doc__)
    made.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="where scenes come from")
    made.add_argument("--seed", type=int, default=0, help="seed of the scenes")
    made.add_argument("--count", type=_positive, default=24, metavar="N", help="scenes to show")
    made.add_argument("--size", type=_side, default=384, metavar="PX", help="side of a picture in pixels")
    made.add_argument("--photos", type=Path, metavar="CSV", help="manifest whose first photos are shown too")
    made.add_argument("--out", type=Path, default=Path("preview"), metavar="DIR", help="the pictures' folder")
    made.add_argument(
        "--print-ranges", action="store_true", help="print --ranges as TOML to edit, and make no pictures"
    )
    return made


def _positive(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to 10000")
    return int(text)


def _side(text: str) -> int:
    if not text.isdigit() or not 32 <= int(text) <= 4096:
        raise argparse.ArgumentTypeError(f"{text!r} is not a side between 32 and 4096 pixels")
    return int(text)


if __name__ == "__main__":
    run(main)
