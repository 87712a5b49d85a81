"""Exemplar repainting: frames of leaves, warps between them, gaps, imperfections."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from leaf_photos import draw_leaf, draw_paper, save_photos
from record_sets import SPEC, write_dataset

from laesi_tf import inpaint
from laesi_tf.common.errors import InputError
from laesi_tf.data.stored_samples import read_records
from laesi_tf.inpainting.base import MaskedImage, image_seed
from laesi_tf.inpainting.donor_leaves import Donor, cut_out_donor
from laesi_tf.inpainting.exemplar import ExemplarInpainter
from laesi_tf.inpainting.imperfections import IMPERFECTIONS
from laesi_tf.inpainting.leaf_frame import compare_shapes, fit_leaf_frame
from laesi_tf.inpainting.paper_fill import fill_with_paper
from laesi_tf.inpainting.texture_warp import align_best, fill_gaps, match_light, warp_texture


@pytest.fixture(scope="module")
def donors() -> list[Donor]:
    shapes = [(30, 0), (60, 40), (90, 80)]
    return [cut_out_donor(str(width), *draw_leaf(width=width, hue=hue)) for width, hue in shapes]


def masked(width: float, *, angle: float = 20.0, seed: int = 0) -> MaskedImage:
    image, mask = draw_leaf(length=90, width=width, angle=angle, side=128, hue=-40)
    return MaskedImage(image=image, mask=mask, prompt="oak leaf", species="oak", seed=seed)


@given(angle=st.floats(0, 360), width=st.floats(25, 90))
def test_the_frame_of_a_leaf_lies_along_its_midrib(angle: float, width: float) -> None:
    _, mask = draw_leaf(width=width, angle=angle)
    frame = fit_leaf_frame(mask)
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    assert frame.has_petiole and frame.axis @ direction > 0.99
    assert frame.length == pytest.approx(121, abs=6) and frame.width == pytest.approx(width, abs=5)
    points = frame.to_pixels(np.array([[0.0, 0.0], [0.5, 0.9], [1.0, 0.0], [-0.1, 0.0]]))
    np.testing.assert_allclose(frame.to_leaf(points), [[0, 0], [0.5, 0.9], [1, 0], [-0.1, 0]], atol=1e-6)
    np.testing.assert_allclose(points[0], 100.5 - 60 * direction, atol=4)


def test_leaves_of_one_shape_compare_equal() -> None:
    one, turned, wider = (
        fit_leaf_frame(draw_leaf(width=width, angle=angle)[1])
        for width, angle in ((50, 0), (50, 70), (75, 0))
    )
    assert compare_shapes(one, turned) < 0.1 < compare_shapes(one, wider)


@pytest.mark.parametrize(("width", "donor"), [(24, "30"), (46, "60"), (70, "90")])
def test_the_donor_of_the_closest_shape_is_taken(donors: list[Donor], width: float, donor: str) -> None:
    assert align_best(fit_leaf_frame(masked(width).mask), donors).donor.name == donor


def test_a_leaf_warped_onto_itself_stays_as_it_is() -> None:
    image, mask = draw_leaf(width=60, angle=30)
    donor, frame = cut_out_donor("itself", image, mask), fit_leaf_frame(mask)
    warp = warp_texture(align_best(frame, [donor]), frame, mask)
    inner = warp.is_leaf
    assert inner[mask].mean() > 0.85
    assert np.abs(warp.colour - image)[inner].mean() < 3


def test_gaps_are_filled_with_colours_of_the_leaf(donors: list[Donor]) -> None:
    target = masked(46)
    frame = fit_leaf_frame(target.mask)
    warp = warp_texture(align_best(frame, donors[1:2]), frame, target.mask)
    assert not warp.is_leaf[target.mask].all()
    filled = fill_gaps(warp, target.mask)[target.mask]
    # Leaf and veins have less blue than the paper.
    assert filled[:, 2].max() < 120 and filled.min() >= 0


def test_the_texture_takes_the_brightness_of_the_paper(donors: list[Donor]) -> None:
    target = masked(46)
    texture = np.full((*target.mask.shape, 3), 100, np.float32)
    bright, dark = (
        match_light(texture, donors[0], (target.image * share).astype(np.uint8), target.mask)[target.mask]
        for share in (1.0, 0.5)
    )
    assert bright.mean() == pytest.approx(100, abs=5) and 55 < dark.mean() < 75


def test_paper_continues_its_lines_below_the_leaf() -> None:
    paper = draw_paper(128)
    target = masked(46)
    filled = fill_with_paper(np.where(target.mask[..., None], target.image, paper), target.mask)
    np.testing.assert_array_equal(filled, paper)


def test_paper_is_filled_with_paper_and_not_with_the_desk() -> None:
    scene = draw_paper(128)
    scene[:, 90:] = 40
    mask = np.zeros((128, 128), bool)
    mask[20:100, 10:80] = True
    filled = fill_with_paper(np.where(mask[..., None], 0, scene).astype(np.uint8), mask)
    assert (filled[mask] > 100).mean() > 0.99


def test_paper_below_a_leaf_that_fills_the_image_has_its_colour() -> None:
    image = draw_paper(64)
    mask = np.zeros((64, 64), bool)
    mask[6:58, 6:58] = True
    filled = fill_with_paper(np.where(mask[..., None], 0, image).astype(np.uint8), mask)
    assert filled.min() > 100
    assert fill_with_paper(image, np.ones((64, 64), bool)).min() == 255


def test_each_image_depends_on_its_seed_only(donors: list[Donor]) -> None:
    inpainter = ExemplarInpainter(donors, compared=2, imperfect=0.5)
    images = [masked(40 + 5 * number, seed=number) for number in range(6)]
    together = [result.image for result in inpainter.repaint(images)]
    alone = [inpainter.repaint([image])[0].image for image in reversed(images)]
    np.testing.assert_array_equal(together, alone[::-1])
    assert image_seed(0, 3, 7) == image_seed(0, 3, 7) != image_seed(1, 3, 7)


def is_paper(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return (image[..., 2] > 130) & mask


def test_faithful_leaves_fill_their_masks(donors: list[Donor]) -> None:
    for seed in range(5):
        image = masked(46, seed=seed)
        painted = ExemplarInpainter(donors).repaint([image])[0]
        assert painted.imperfection == "" and not is_paper(painted.image, image.mask).any()
        np.testing.assert_array_equal(painted.image[~image.mask], image.image[~image.mask])


def test_imperfect_leaves_leave_paper_bare(donors: list[Donor]) -> None:
    shares: dict[str, list[float]] = {name: [] for name in IMPERFECTIONS}
    for seed in range(30):
        image = masked(46, seed=seed)
        painted = ExemplarInpainter(donors, imperfect=1.0).repaint([image])[0]
        shares[painted.imperfection].append(
            float(is_paper(painted.image, image.mask).sum() / image.mask.sum())
        )
    for name, found in shares.items():
        assert len(found) > 3 and max(found) > 0.15, name
    assert min(map(min, shares.values())) < 0.1


def test_the_command_uses_the_split_that_is_named(tmp_path: Path) -> None:
    textures = save_photos(tmp_path / "photos")
    write_dataset(tmp_path / "set")
    arguments = [str(tmp_path / "set"), "--model", "exemplar", "--textures", str(textures)]
    inpaint.main([*arguments, "--textures-split", "train", "--out", str(tmp_path / "out")])
    samples = [s for path in sorted((tmp_path / "out").glob("*.tfrecord")) for s in read_records(path)]
    assert len(samples) == SPEC.count
    assert {sample.values["inpaint_model"] for sample in samples} == {"exemplar"}
    with pytest.raises(InputError, match="other settings: textures_split"):
        inpaint.main([*arguments, "--textures-split", "test", "--out", str(tmp_path / "out")])


@pytest.mark.parametrize(
    ("manifest", "message"),
    [
        (None, r"manifest.csv is missing"),
        ("image,area_cm2\n0.png,3\n", "no photo in .* has a mask"),
        ("image,area_cm2,mask\n0.png,3,gone.png\n", "none of the 1 photos .* can be used"),
    ],
)
@pytest.mark.filterwarnings("ignore:texture skipped")
def test_folders_without_usable_textures_are_refused(
    tmp_path: Path, manifest: str | None, message: str
) -> None:
    textures = save_photos(tmp_path / "photos")
    (textures / "manifest.csv").unlink()
    if manifest is not None:
        (textures / "manifest.csv").write_text(manifest)
    write_dataset(tmp_path / "set")
    arguments = [str(tmp_path / "set"), "--model", "exemplar", "--out", str(tmp_path / "out")]
    with pytest.raises(InputError, match="needs --textures"):
        inpaint.main(arguments)
    with pytest.raises(InputError, match=message):
        inpaint.main([*arguments, "--textures", str(textures)])


def test_leaves_of_a_few_pixels_get_the_colour_of_a_leaf(donors: list[Donor]) -> None:
    for side in (1, 2, 4):
        mask = np.zeros((32, 32), bool)
        mask[10 : 10 + side, 12 : 12 + side] = True
        image = MaskedImage(image=draw_paper(32), mask=mask, prompt="", species=None, seed=side)
        for imperfect in (0.0, 1.0):
            painted = ExemplarInpainter(donors, imperfect=imperfect).repaint([image])[0].image
            assert painted[~mask].min() >= 150 and (imperfect or painted[mask][:, 2].max() < 130)


def test_the_largest_of_several_leaves_is_the_donor() -> None:
    image, mask = draw_leaf(length=80, width=40, side=200)
    mask[150:180, 150:180] = True
    alone = cut_out_donor("alone", *draw_leaf(length=80, width=40, side=200))
    assert compare_shapes(cut_out_donor("several", image, mask).frame, alone.frame) < 0.01


def test_a_leaf_that_is_too_small_or_narrow_is_no_donor() -> None:
    line = np.zeros((600, 600), bool)
    line[100:500, 300:303] = True
    with pytest.raises(InputError, match="too narrow"):
        cut_out_donor("line", draw_paper(600), line)
    image, mask = draw_leaf(length=20, width=8)
    with pytest.raises(InputError, match="pixels; at least"):
        cut_out_donor("small", image, mask)
