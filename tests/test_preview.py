"""The contact sheets from the command line."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from green import photo
from PIL import Image
from scenes import RENDERING_2, changed, only

from laesi_tf import preview
from laesi_tf.common.errors import InputError
from laesi_tf.reporting import scene_tiles
from laesi_tf.synthesis import COMPONENTS, load_ranges
from laesi_tf.synthesis.presets import PRESETS
from laesi_tf.synthesis.ranges import Probability

SHEETS = ("scenes.png", "components.png", "passes.png", "masks.png")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_tiles, "_CANDIDATES", 1)
    monkeypatch.setattr(scene_tiles, "_LEAVES", 1)


@pytest.fixture
def simple(tmp_path: Path) -> Path:
    """Ranges with two components."""
    path = tmp_path / "simple.toml"
    names = ", ".join(f'"{name}"' for name in COMPONENTS if name not in ("ruling", "shadow"))
    path.write_text(f"without = [{names}]\n")
    return path


def test_sheets_and_their_labels(simple: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    arguments = ["--ranges", str(simple), "--count", "7", "--size", "64", "--out", str(out)]
    preview.main([*arguments, "--json", str(tmp_path / "a.json")])
    report = json.loads((tmp_path / "a.json").read_text())
    assert report["files"] == [str(out / name) for name in SHEETS] == capsys.readouterr().out.split()
    for name, columns, rows in zip(SHEETS, (6, 3, 4, 6), (2, 1, 1, 2), strict=True):
        with Image.open(out / name) as sheet:
            assert sheet.width == 12 + columns * (64 + 12)
            assert rows * (64 + 12) < sheet.height < rows * (64 + 12 + 24) + 12
    assert [scene["index"] for scene in report["scenes"]] == list(range(7))
    assert len({scene["area_cm2"] for scene in report["scenes"]}) == 7
    assert set(report["scenes"][0]) == {"index", "area_cm2", "px_per_mm", "tilt_deg"}


def test_each_component_changes_the_tile_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_tiles, "_CANDIDATES", 3)
    with_square = changed(RENDERING_2, "props", calibration=Probability(0.5))
    tiles = scene_tiles.component_tiles(with_square, seed=0, size=256)
    assert len(tiles) == len(with_square.list_enabled_components()) + 1
    same = [
        number for number, (one, other) in enumerate(itertools.pairwise(tiles))
        if not scene_tiles._is_visibly_different(one[:256], other[:256])
    ]  # fmt: skip
    assert not same


def test_components_that_ranges_leave_out_are_not_shown() -> None:
    assert len(scene_tiles.component_tiles(only("ruling", "spots"), seed=0, size=48)) == 3


def test_passes_show_one_leaf_in_four_lights() -> None:
    tiles = [tile[:64] for tile in scene_tiles.lighting_tiles(only("illumination"), seed=0, size=64)]
    assert len(tiles) == 4
    assert all(scene_tiles._is_visibly_different(one, other) for one, other in itertools.pairwise(tiles))


def test_photos_stand_beside_the_scenes(simple: Path, tmp_path: Path) -> None:
    Image.fromarray(photo(80, 60)).save(tmp_path / "good.png")
    (tmp_path / "bad.png").write_bytes(b"not an image")
    (tmp_path / "manifest.csv").write_text("image,area_cm2\ngood.png,3\nbad.png,4\n")
    arguments = ["--ranges", str(simple), "--count", "4", "--size", "64", "--out", str(tmp_path / "out")]
    preview.main([*arguments, "--photos", str(tmp_path / "manifest.csv")])
    with Image.open(tmp_path / "out" / "scenes.png") as sheet:
        first, second = (np.asarray(sheet.crop((12 + 76 * i, 12, 76 + 76 * i, 76))) for i in range(2))
    # The photo's leaf in the middle; a grey tile for the one that cannot be read.
    np.testing.assert_allclose(first[32, 32], (40, 160, 40), atol=3)
    assert (second == 230).all()


def test_printed_ranges_can_be_read_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    preview.main(["--ranges", "rendering_1", "--print-ranges", "--json", str(tmp_path / "ranges.json")])
    printed = capsys.readouterr().out
    (tmp_path / "mine.toml").write_text(printed)
    read, preset = load_ranges(tmp_path / "mine.toml"), PRESETS["rendering_1"]
    assert read.paper == preset.paper and read.light == preset.light
    assert json.loads((tmp_path / "ranges.json").read_text())["paper"]["gradient_weight"] == [0.0, 0.2]
    assert not (tmp_path / "preview").exists()


BAD = [
    ["--count", "0"],
    ["--seed", "-3"],
    ["--size", "20"],
    ["--size", "big"],
    ["--ranges", "rendering_9"],
    ["--photos", "none.csv"],
]


@pytest.mark.parametrize("arguments", BAD)
def test_bad_input(arguments: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError):
        preview.main([*arguments, "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
