"""Named ranges, TOML files of ranges, and their errors."""

import dataclasses
from pathlib import Path

import pytest
from scenes import RENDERING_2, bounds, specs

from laesi_tf.common.errors import InputError
from laesi_tf.synthesis import Ranges, load_ranges, synthesise
from laesi_tf.synthesis.presets import PRESETS, enable_all_components
from laesi_tf.synthesis.ranges import Choice, Probability, fields_of
from laesi_tf.synthesis.ranges_toml import ranges_to_toml
from laesi_tf.synthesis.scene import PARTS


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def same(one: Ranges, other: Ranges) -> bool:
    """Return whether two Ranges sample alike; a single number equals an interval of no width."""
    flat = [
        [
            (part, field, spec if isinstance(spec, Probability | Choice) else bounds(spec))
            for part, field, spec in specs(ranges)
        ]
        for ranges in (one, other)
    ]
    weights = [[weight for weight, _ in ranges.leaf.values()] for ranges in (one, other)]
    rest = [(ranges.lighting_passes, ranges.without) for ranges in (one, other)]
    return flat[0] == flat[1] and weights[0] == weights[1] and rest[0] == rest[1]


def test_rendering_1_is_rendering_2_with_a_noisier_paper() -> None:
    noisy, narrow = (load_ranges(name) for name in ("rendering_1", "rendering_2"))
    assert dataclasses.replace(noisy, paper=narrow.paper) == narrow
    differing = {
        name: (fields_of(noisy.paper)[name], spec)
        for name, spec in fields_of(narrow.paper).items()
        if fields_of(noisy.paper)[name] != spec
    }
    noise = {"gradient_weight", "voronoi_weight", "simple_weight", "print_wear", "creased", "crease_depth"}
    assert set(differing) == noise
    for name, (wide, usual) in differing.items():
        if isinstance(wide, Probability):
            assert wide.p > usual.p, name
        else:
            assert bounds(wide)[0] <= bounds(usual)[0] or name == "crease_depth", name
            assert bounds(wide)[1] > bounds(usual)[1], name


def test_ranges_pass_through() -> None:
    assert load_ranges(RENDERING_2) is RENDERING_2


def test_a_file_changes_only_what_it_names(tmp_path: Path) -> None:
    text = """
        base = "rendering_1"
        lighting_passes = 2
        without = ["glass", "pen"]
        [paper]
        hue = [0.1, 0.2]
        brightness = 0.9
        tinted = {chance = 0.25}
        [leaf.oak]
        weight = 3
        length_mm = [60, 120]
        [leaf.spiny]
        weight = 0
    """
    read, base = load_ranges(written(tmp_path, text)), PRESETS["rendering_1"]
    assert (read.lighting_passes, read.without) == (2, {"glass", "pen"})
    paper = dataclasses.replace(
        read.paper, **{k: fields_of(base.paper)[k] for k in ("hue", "brightness", "tinted")}
    )
    assert paper == base.paper
    assert (read.paper.hue, read.paper.tinted) == ((0.1, 0.2), Probability(0.25))
    assert bounds(read.paper.brightness) == (0.9, 0.9)
    assert "spiny" not in read.leaf and read.leaf["beech"] == base.leaf["beech"]
    weight, oak = read.leaf["oak"]
    assert weight == 3 and oak == dataclasses.replace(base.leaf["oak"][1], length_mm=(60.0, 120.0))
    assert [getattr(read, part) for part in PARTS[1:]] == [getattr(base, part) for part in PARTS[1:]]


BAD = {
    "paprika = 1": "paprika",
    "[paper]\nhu = [0, 1]": "hue",
    "[paper]\nhue = [1, 0]": "hue",
    '[paper]\nhue = "red"': "hue",
    "[paper]\nhue = [0, 1, 2]": "hue",
    "[paper]\ntinted = 0.5": "tinted",
    "[paper]\nkind = {plane = 1}": "plain",
    "[paper]\nkind = {plain = 0}": "kind",
    "[paper]\nkind = 3": "kind",
    "[paper]\ntinted = {chance = 1.5}": "tinted",
    "paper = 3": "paper",
    "[leaf.maple]\nweight = 1": "maple",
    "[leaf.oak]\nweight = -1": "weight",
    "[leaf.oak]\nlobe_dept = 0.3": "lobe_depth",
    "lighting_passes = 0": "lighting_passes",
    'lighting_passes = "four"': "lighting_passes",
    'without = ["glas"]': "glass",
    'without = "glass"': "list of components",
    "without = [3]": "list of components",
    "lighting_passes = true": "lighting_passes",
    "[paper]\nhue = [nan, 1]": "hue",
    "[paper]\nhue = inf": "hue",
    "[paper]\nhue = [false, true]": "hue",
    "[camera]\nclosest_mm = 20": "closest_mm",
    "[leaf.oak]\nveins = [8, 25]": "veins",
    'base = "rendering_3"': "rendering_3",
    "[paper\nhue = 1": "line 1",
    "\n".join(f"[leaf.{kind}]\nweight = 0" for kind in RENDERING_2.leaf): "weight",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files_name_file_and_key_in_one_line(text: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load_ranges(path)
    message = str(caught.value)
    assert str(path) in message and BAD[text] in message and "\n" not in message


@pytest.mark.parametrize("source", ["rendering_3", "nowhere.toml", "ranges.yaml"])
def test_unknown_ranges(source: str) -> None:
    with pytest.raises(InputError, match=source):
        synthesise(0, size=(32, 32), ranges=source)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_being_written_and_read(name: str, tmp_path: Path) -> None:
    assert same(load_ranges(written(tmp_path, ranges_to_toml(PRESETS[name]))), PRESETS[name])


def test_kinds_left_out_are_written_in_one_order() -> None:
    """Data sets store this text and are continued only with the same text, so hash seeds must not matter."""
    name, one = next(iter(RENDERING_2.leaf.items()))
    lines = ranges_to_toml(dataclasses.replace(RENDERING_2, leaf={name: one})).splitlines()
    kinds = [line[6:-1] for line in lines if line.startswith("[leaf.")]
    assert kinds == [name, *(kind for kind in RENDERING_2.leaf if kind != name)]


def test_edited_ranges_survive_being_written_and_read(tmp_path: Path) -> None:
    text = """
        lighting_passes = 1
        without = ["pen", "desk"]
        [leaf.oak]
        weight = 0
        [light]
        glass = {chance = 0}
    """
    edited = load_ranges(written(tmp_path, text))
    assert same(load_ranges(written(tmp_path, ranges_to_toml(edited))), edited) and not same(
        edited, RENDERING_2
    )


def test_every_component_leaves_nothing_to_chance() -> None:
    full = enable_all_components(RENDERING_2)
    chances = {spec.p for _, _, spec in specs(full) if isinstance(spec, Probability)}
    others = [
        [spec for _, _, spec in specs(r) if not isinstance(spec, Probability)] for r in (full, RENDERING_2)
    ]
    assert full.props.calibration == Probability(0.0)  # what is never shown stays away
    assert chances == {0.0, 1.0} and others[0] == others[1]
    assert [weight for weight, _ in full.leaf.values()] == [weight for weight, _ in RENDERING_2.leaf.values()]
