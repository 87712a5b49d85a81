"""Nuisances change what they say and nothing else; trials continue; summaries are those of known trials."""

import csv
from pathlib import Path

import numpy as np
import pytest
from green import disk, photo
from hypothesis import given, settings
from hypothesis import strategies as st
from photo_sets import make_photo_set

from laesi_tf import stress
from laesi_tf.benchmarks.stress import photo_filters, summary
from laesi_tf.benchmarks.stress.nuisances import NUISANCES
from laesi_tf.benchmarks.stress.sources import PhotoSource, SceneSource
from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.benchmarks.stress.trials import Trial, TrialFile
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import select_by_name
from laesi_tf.data.manifest import read_manifest

LEAF = StressPhoto(image=photo(300, 400), mask=disk(300, 400), area_cm2=25.0, px_per_mm=3.0)
ON_PHOTOS = [nuisance for nuisance in NUISANCES if nuisance.of_photo is not None]


@pytest.fixture(scope="module")
def scenes() -> SceneSource:
    return SceneSource(1, seed=3, size=(96, 96))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


# Props take a compilation of each kind.
@pytest.mark.parametrize(
    "nuisance", [n for n in NUISANCES if n.name != "clutter"], ids=lambda nuisance: nuisance.name
)
def test_the_worst_of_a_nuisance_differs_from_none(nuisance, scenes: SceneSource) -> None:  # type: ignore[no-untyped-def]
    calm, worst = scenes.make(0, nuisance, 0), scenes.make(0, nuisance, len(nuisance.severities) - 1)
    assert calm.image.shape == (96, 96, 3) and calm.mask.any() and calm.area_cm2 > 1
    assert worst.image.shape != calm.image.shape or (worst.image != calm.image).any()
    assert len(nuisance.labels) in (0, len(nuisance.severities))


def test_none_is_the_same_picture_for_all(scenes: SceneSource) -> None:
    pictures = [scenes.make(0, nuisance, 0).image for nuisance in NUISANCES[:4]]
    assert all(np.array_equal(pictures[0], picture) for picture in pictures)


def test_only_the_light_changes_with_the_shadow(scenes: SceneSource) -> None:
    (shadow,) = select_by_name(NUISANCES, ["shadow"], "nuisance")
    calm, worst = scenes.make(0, shadow, 0), scenes.make(0, shadow, 5)
    assert np.array_equal(calm.mask, worst.mask) and calm.area_cm2 == worst.area_cm2


def test_unknown_numbers_of_a_scene_are_errors(scenes: SceneSource) -> None:
    with pytest.raises(KeyError, match=r"camera\.zoom"):
        scenes._scenes.render(0, {"camera.zoom": 1})
    with pytest.raises(InputError, match="there are tilt, roll"):
        select_by_name(NUISANCES, ["earthquake"], "nuisance")
    assert len(select_by_name(NUISANCES, ["tilt", "tilt"], "nuisance")) == 1


@pytest.mark.parametrize("nuisance", ON_PHOTOS, ids=lambda nuisance: nuisance.name)
def test_photos_keep_their_kind_and_their_original(nuisance) -> None:  # type: ignore[no-untyped-def]
    before = LEAF.image.copy()
    assert nuisance.of_photo is not None
    for severity in nuisance.severities[1:]:
        changed = nuisance.of_photo(LEAF, severity, rng())
        assert changed.image.dtype == np.uint8 and changed.image.shape[:2] == changed.mask.shape
        assert np.array_equal(LEAF.image, before)


@settings(max_examples=15)
@given(angle=st.floats(1, 45), seed=st.integers(0, 2**32))
def test_tilting_keeps_the_true_area(angle: float, seed: int) -> None:
    tilted = photo_filters.tilt_photo(LEAF, angle, np.random.default_rng(seed))
    assert tilted.area_cm2 == pytest.approx(25.0, rel=0.01)
    assert tilted.mask.sum() <= LEAF.mask.sum()


@settings(max_examples=15)
@given(k1=st.floats(0.0, 0.3))
def test_distortion_keeps_the_true_area_and_the_scale_in_the_middle(k1: float) -> None:
    distorted = photo_filters.distort_photo(LEAF, k1, rng())
    assert distorted.area_cm2 == pytest.approx(25.0, rel=0.01)
    assert distorted.px_per_mm == pytest.approx(3.0, rel=0.01)


@settings(max_examples=15)
@given(share=st.floats(0.05, 0.5), seed=st.integers(0, 2**32))
def test_what_a_finger_covers_does_not_count(share: float, seed: int) -> None:
    covered = photo_filters.cover_leaf(LEAF, share, np.random.default_rng(seed))
    assert covered.area_cm2 == pytest.approx(25.0 * (1 - share), rel=0.03)
    # The finger shows no green.
    assert not (covered.image[LEAF.mask & ~covered.mask] == (40, 160, 40)).all(axis=1).any()


def test_fewer_pixels_lower_the_scale() -> None:
    small = photo_filters.shrink_photo(LEAF, 0.5, rng())
    assert small.image.shape == (150, 200, 3) and small.px_per_mm == 1.5 and small.area_cm2 == 25.0


def trial(step: int, predicted: float | None, *, picture: int = 0, sd: float | None = None) -> Trial:
    refusal = None if predicted is not None else "blurred"
    return Trial(
        nuisance="tilt",
        step=step,
        set="scenes",
        method="m",
        picture=picture,
        true_cm2=10.0,
        predicted_cm2=predicted,
        uncertainty_cm2=sd,
        refusal=refusal,
    )


def test_rows_and_breakdowns_are_those_of_the_trials() -> None:
    trials = [
        *(trial(0, area, picture=number, sd=0.1) for number, area in enumerate((10.1, 9.9))),
        *(trial(1, area, picture=number, sd=0.1) for number, area in enumerate((11.2, 10.4))),
        *(trial(2, area, picture=number) for number, area in enumerate((14.0, None))),
    ]
    rows = summary.summarise_trials(trials, NUISANCES)
    assert [row["severity"] for row in rows] == ["0", "10", "20"]
    assert [row["mre_percent"] for row in rows] == pytest.approx([1, 8, 40])
    assert [row["bias_percent"] for row in rows] == pytest.approx([0, 8, 40])
    assert [row["silent_errors"] for row in rows] == [0, 1, 1]
    assert [row["within_2_sd"] for row in rows] == [1.0, 0.0, None]
    (breakdown,) = summary.find_breakdowns(rows)
    assert (breakdown["over_5_percent"], breakdown["over_25_percent"]) == ("10", "20")
    assert breakdown["half_refused"] == "20" and breakdown["silent_errors"] == 2


def test_setting_aside_the_least_certain_lowers_the_risk() -> None:
    trials = [trial(0, 10 + number / 10, picture=number, sd=(number + 1) / 50) for number in range(20)]
    (risk,) = summary.measure_risk(trials).values()
    assert risk == pytest.approx([np.mean(range(kept)) for kept in (20, 19, 18, 16)])


def test_trials_continue_and_other_settings_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "new" / "trials"
    first = TrialFile(path, {"seed": 1}, {"m": "a"})
    first.add([trial(0, 10.0), trial(1, None)])
    with path.open("a") as file:
        file.write('{"nuisance": "ti')  # killed while it wrote
    assert TrialFile(path, {"seed": 1}, {"m": "a", "n": "b"}).trials == first.trials
    with pytest.raises(InputError, match="other settings"):
        TrialFile(path, {"seed": 2}, {})
    with pytest.raises(InputError, match="another 'n'"):
        TrialFile(path, {"seed": 1}, {"n": "c"})
    path.write_bytes(b"")
    assert TrialFile(path, {"seed": 2}, {}).trials == {}
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="no file of trials"):
        TrialFile(path, {"seed": 2}, {})


def test_command_writes_table_and_page_and_continues(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["--methods", "excess_green", "rule_based", "--nuisances", "noise", "line families"]
    arguments += ["--pictures", "1", "--size", "96", "--out", str(out)]
    stress.main(arguments)
    printed = capsys.readouterr().out
    assert "excess_green breaks at:" in printed and "noise (levels of 255)" in printed
    with (out / "stress.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (6 + 7) and {row["method"] for row in rows} == {"excess_green", "rule_based"}
    page = (out / "stress.html").read_text()
    assert page.count("data:image/png;base64") == 2 and "http" not in page
    lines = (out / "stress.trials").read_bytes()
    assert lines.endswith(b"}\n")
    stress.main(arguments)
    assert (out / "stress.trials").read_bytes() == lines


def test_photos_without_masks_are_refused_before_anything_is_measured(tmp_path: Path) -> None:
    write_manifest = make_photo_set(tmp_path)
    manifest = write_manifest("image,area_cm2,px_per_mm\na.png,0.181,5\n")
    with pytest.raises(InputError, match=r"a\.png needs a mask"):
        PhotoSource(read_manifest(manifest), 3, seed=0)
    manifest = write_manifest("image,mask,area_cm2,px_per_mm\na.png,masks/a.png,0.181,5\n")
    source = PhotoSource(read_manifest(manifest), 3, seed=0)
    assert source.count == 1 and source.digest != SceneSource(1, seed=0, size=(96, 96)).digest
