"""Render scenes of --ranges as contact sheets, to look at before training on them.

scenes.png shows different leaves (next to photos with --photos), components.png one scene with each component
added in turn, passes.png leaves in different light, masks.png outlines and labels.
"""

import argparse
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.parsing import non_negative_int
from laesi_tf.data.manifest import read_manifest

if TYPE_CHECKING:
    from laesi_tf.synthesis import Ranges


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for unknown ranges, a bad manifest or a folder it cannot write."""
    options = _make_parser().parse_args(arguments)
    photos = read_manifest(options.photos) if options.photos else []
    load_tensorflow(quick_compilation=True)
    from laesi_tf.reporting import scene_tiles
    from laesi_tf.reporting.captions import make_contact_sheet
    from laesi_tf.reporting.overlay import write_png
    from laesi_tf.synthesis import load_ranges

    ranges = load_ranges(options.ranges)
    if options.print_ranges:
        _print_ranges(ranges, options.json)
        return
    require_writable(options.out / "scenes.png")
    seed, size = options.seed, options.size
    scenes = scene_tiles.render_scenes(ranges, seed=seed, count=options.count, size=size)
    photos_shown = photos[: scene_tiles.COLUMNS]
    sheets = {
        "scenes.png": [*scene_tiles.photo_tiles(photos_shown, size), *scene_tiles.scene_tiles(scenes)],
        "components.png": scene_tiles.component_tiles(ranges, seed=seed, size=size),
        "passes.png": scene_tiles.lighting_tiles(ranges, seed=seed, size=size),
        "masks.png": scene_tiles.mask_tiles(scenes),
    }
    columns = {"passes.png": scene_tiles.PASSES}
    for name, tiles in sheets.items():
        write_png(
            options.out / name, make_contact_sheet(tiles, columns=columns.get(name, scene_tiles.COLUMNS))
        )
    files = [str(options.out / name) for name in sheets]
    if options.json is not None:
        write_json(options.json, {"files": files, "scenes": [scene.label for scene in scenes]})
    print("\n".join(files))


def _print_ranges(ranges: "Ranges", json_path: Path | None) -> None:
    from laesi_tf.synthesis.ranges_toml import ranges_to_toml

    text = ranges_to_toml(ranges)
    if json_path is not None:
        write_json(json_path, tomllib.loads(text))
    print(text, end="")


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("preview", __doc__)
    parser.add_argument("--ranges", default="rendering_2", metavar="PRESET|FILE", help="ranges of the scenes")
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of the scenes")
    parser.add_argument("--count", type=_parse_count, default=24, metavar="N", help="number of scenes")
    parser.add_argument(
        "--size", type=_parse_side, default=384, metavar="PX", help="side of an image in pixels"
    )
    parser.add_argument(
        "--photos", type=Path, metavar="CSV", help="manifest whose first photos are shown as well"
    )
    parser.add_argument("--out", type=Path, default=Path("preview"), metavar="DIR", help="output folder")
    parser.add_argument(
        "--print-ranges", action="store_true", help="print --ranges as TOML to edit, render nothing"
    )
    return parser


def _parse_count(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to 10000")
    return int(text)


def _parse_side(text: str) -> int:
    if not text.isdigit() or not 32 <= int(text) <= 4096:
        raise argparse.ArgumentTypeError(f"{text!r} is not a side between 32 and 4096 pixels")
    return int(text)


if __name__ == "__main__":
    run_command(main)
