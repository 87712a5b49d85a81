"""Photos as training samples, in memory and decoded again each time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from photo_sets import WriteManifest, make_photo_set

from laesi_tf.common.errors import InputError
from laesi_tf.data.decoding import read_upright_size
from laesi_tf.data.manifest import read_manifest
from laesi_tf.data.photo_dataset import IndexedSamples, load_into_memory, stream_from_disk
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.tasks import make_task

OpenPhotos = Callable[..., IndexedSamples]
make_target = make_task(TrainConfig(task="area")).make_target


@pytest.fixture
def write(tmp_path: Path) -> WriteManifest:
    return make_photo_set(tmp_path)


def get(samples: IndexedSamples, index: int) -> dict[str, np.ndarray]:
    return {name: value.numpy() for name, value in samples.get(tf.constant(index, tf.int64)).items()}


@pytest.fixture(params=["memory", "disk"])
def open_photos(request: pytest.FixtureRequest) -> OpenPhotos:
    """Both ways to use the photos of a manifest."""

    def open_(path: Path, *, needs_masks: bool = False) -> IndexedSamples:
        photos = read_manifest(path)
        if request.param == "disk":
            return stream_from_disk(photos, size=(32, 32), needs_masks=needs_masks)
        return load_into_memory(photos, size=(32, 32), needs_masks=needs_masks)[0]

    return open_


def test_samples_are_the_photos_in_order(write: WriteManifest, open_photos: OpenPhotos) -> None:
    samples = open_photos(write("image,area_cm2\na.png,12.5\nb.png,3\n"))
    assert samples.count == 2
    both = [get(samples, index) for index in (0, 1)]
    assert [float(sample["area_cm2"]) for sample in both] == [12.5, 3.0]
    for sample in both:
        assert np.isnan(sample["px_per_mm"]) and not sample["mask"].any()
        assert sample["image"].shape == (32, 32, 3) and sample["image"].dtype == np.uint8
        assert np.isnan(make_target(sample).numpy()[1:]).all()


def test_samples_have_the_factors_of_the_area(write: WriteManifest, open_photos: OpenPhotos) -> None:
    path = write("image,area_cm2,mask,px_per_mm\nb.png,3,masks/b.png,4\n")
    sample = get(open_photos(path, needs_masks=True), 0)
    is_green = sample["image"][..., 1].astype(int) - sample["image"][..., 0] > 60
    assert sample["mask"].dtype == np.uint8 and (is_green != sample["mask"].astype(bool)).mean() < 0.02
    (photo,) = read_manifest(path)
    assert sample["px_per_mm"] == pytest.approx(4 * 32 / max(read_upright_size(photo.image)))
    assert make_target(sample).numpy()[2] == pytest.approx(is_green.mean(), abs=0.02)


@pytest.fixture
def with_truncated_photo(write: WriteManifest) -> Path:
    path = write("image,area_cm2\na.png,12.5\ncut.png,5\nb.png,3\n")
    (path.parent / "cut.png").write_bytes((path.parent / "a.png").read_bytes()[:70])
    return path


def test_skipped_photos_are_named(with_truncated_photo: Path) -> None:
    samples, skipped = load_into_memory(read_manifest(with_truncated_photo), size=(32, 32), needs_masks=False)
    assert [photo.name for photo in skipped] == ["cut.png"] and "cannot be decoded" in skipped[0].reason
    assert [float(get(samples, index)["area_cm2"]) for index in range(samples.count)] == [12.5, 3.0]


def test_the_next_photo_replaces_one_that_cannot_be_decoded(with_truncated_photo: Path) -> None:
    samples = stream_from_disk(read_manifest(with_truncated_photo), size=(32, 32), needs_masks=False)
    assert [float(get(samples, index)["area_cm2"]) for index in range(3)] == [12.5, 3.0, 3.0]


def test_no_usable_photo_is_an_error(write: WriteManifest) -> None:
    photos = read_manifest(write("image,area_cm2\na.png,12.5\n"))
    with pytest.raises(InputError, match=r"none of the 1 photos.*no mask"):
        load_into_memory(photos, size=(32, 32), needs_masks=True)
    with pytest.raises(InputError, match=r"none of the 1 photos.*no mask"):
        get(stream_from_disk(photos, size=(32, 32), needs_masks=True), 0)
