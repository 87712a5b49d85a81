"""Leaves that are pasted beside others, and the count of those that an estimator misses."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from laesi_tf.benchmarks.pasted_leaves import SeveralLeaves, measure_pasted_leaves, paste_leaves
from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.data.manifest import Photo, read_manifest
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.ruling_estimator import UNCOUNTED

PAPER, GREEN = (230, 228, 222), (60, 120, 50)


@pytest.fixture
def photos(tmp_path: Path) -> list[Photo]:
    """Four photos of a green leaf on paper beside a dark desk."""
    rows = ["image,area_cm2,mask"]
    for number in range(4):
        image = np.full((400, 600, 3), PAPER, np.uint8)
        image[:, 520:] = (60, 50, 90)
        mask = np.zeros((400, 600), np.uint8)
        cv2.ellipse(mask, (150, 200), (60 + 8 * number, 40), 30 * number, 0, 360, 255, -1)
        image[mask > 0] = GREEN
        cv2.imwrite(str(tmp_path / f"{number}.png"), image[..., ::-1])
        cv2.imwrite(str(tmp_path / f"{number}-mask.png"), mask)
        rows.append(f"{number}.png,5,{number}-mask.png")
    (tmp_path / "manifest.csv").write_text("\n".join(rows))
    return read_manifest(tmp_path / "manifest.csv")


class GreenFinder:
    """Finds green pieces but the `missed` smallest ones, and says `note`."""

    def __init__(self, missed: int, note: str | None = None) -> None:
        self.missed, self.note = missed, note

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        del info
        pieces = trace_polygons((image[..., 1] > 90) & (image[..., 0] < 110) & (image[..., 2] < 100))
        kept = pieces[: len(pieces) - self.missed]
        leaves = tuple(LeafMeasurement(outline=piece.outer, area_cm2=1.0) for piece in kept)
        return Measurement(method="green", leaves=leaves, note=self.note)


def check_scene(scene: SeveralLeaves) -> None:
    assert 1 <= len(scene.leaves) <= 4
    assert np.sum(scene.leaves, axis=0).max() == 1
    for leaf in scene.leaves:
        inside = cv2.erode(leaf.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        assert np.abs(scene.image[inside].astype(int) - GREEN).max() <= 2
        assert not leaf[:, 525:].any()


def test_pasted_leaves_lie_apart_on_the_paper(photos: list[Photo]) -> None:
    scenes = list(paste_leaves(photos, count=8, seed=1))
    for scene in scenes:
        check_scene(scene)
    assert max(len(scene.leaves) for scene in scenes) >= 3
    again = next(paste_leaves(photos, count=8, seed=1))
    assert (again.image == scenes[0].image).all()
    assert (next(paste_leaves(photos, count=8, seed=2)).image != scenes[0].image).any()


def test_missed_leaves_are_counted(photos: list[Photo]) -> None:
    all_found = measure_pasted_leaves(GreenFinder(0), photos, count=6, seed=1)
    assert (all_found["missed"], all_found["false_outlines"], all_found["refused"]) == (0, 0, 0)
    assert all_found["leaves"] > 8
    silent = measure_pasted_leaves(GreenFinder(1), photos, count=6, seed=1)
    assert silent["missed"] == silent["missed_without_a_note"] == 6
    assert silent["leaves"] == all_found["leaves"]
    noted = measure_pasted_leaves(GreenFinder(1, UNCOUNTED.format(count=1)), photos, count=6, seed=1)
    assert (noted["missed"], noted["missed_without_a_note"]) == (6, 0)


def test_photos_without_masks_are_refused(photos: list[Photo]) -> None:
    bare = [Photo(name=photo.name, image=photo.image, area_cm2=photo.area_cm2) for photo in photos]
    with pytest.raises(InputError, match="mask"):
        next(paste_leaves(bare, count=1, seed=0))
