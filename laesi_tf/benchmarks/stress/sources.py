"""Where pictures come from: calm scenes, or photographs with masks."""

import zlib
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from laesi_tf.benchmarks.stress.calm_scenes import CalmScenes
from laesi_tf.benchmarks.stress.nuisances import Nuisance
from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.common.errors import InputError
from laesi_tf.data.manifest import Photo, digest_photos
from laesi_tf.evaluation.photo_scores import load_photo_and_mask
from laesi_tf.synthesis import SYNTHESIS_VERSION
from laesi_tf.synthesis.geometry import ImageSize


class Source(Protocol):
    """A set of pictures."""

    count: int
    """Number of pictures."""
    digest: str
    """The same for the same pictures."""

    def has(self, nuisance: Nuisance) -> bool:
        """Return whether `nuisance` can be applied to these pictures."""
        ...

    def make(self, picture: int, nuisance: Nuisance, step: int) -> StressPhoto:
        """Return picture number `picture` with severity number `step` of a nuisance; 0 is none."""
        ...


class SceneSource:
    """Calm scenes."""

    def __init__(self, count: int, *, seed: int, size: ImageSize) -> None:
        """Take the number of scenes, their seed and their (height, width)."""
        self.count, self._seed = count, seed
        self.digest = f"synthesis {SYNTHESIS_VERSION}"
        self._scenes = CalmScenes(seed=seed, size=size)

    def has(self, nuisance: Nuisance) -> bool:
        """Return True: every nuisance can be applied to scenes."""
        return True

    def make(self, picture: int, nuisance: Nuisance, step: int) -> StressPhoto:
        """Make a picture as `Source.make`."""
        severity = nuisance.severities[step]
        numbers = nuisance.of_scene(severity) if nuisance.of_scene is not None and step else {}
        scene = self._scenes.render(picture, numbers)
        if nuisance.of_scene is not None or not step:
            return scene
        return _lay_over(scene, nuisance, step, [self._seed, picture])


class PhotoSource:
    """Photographs of one leaf each, with masks."""

    def __init__(self, photos: Sequence[Photo], count: int, *, seed: int) -> None:
        """Take `count` photos, spread over `photos`, and load them.

        Raises InputError for one without mask or scale, and for one that cannot be read.
        """
        spread = np.linspace(0, len(photos) - 1, min(count, len(photos))).astype(int)
        chosen = [photos[index] for index in spread]
        self._photos = [_load(photo) for photo in chosen]
        self.count, self._seed, self.digest = len(chosen), seed, digest_photos(chosen)

    def has(self, nuisance: Nuisance) -> bool:
        """Return whether `nuisance` can be applied to a photo."""
        return nuisance.of_photo is not None

    def make(self, picture: int, nuisance: Nuisance, step: int) -> StressPhoto:
        """Make a picture as `Source.make`."""
        photo = self._photos[picture]
        return _lay_over(photo, nuisance, step, [self._seed, picture]) if step else photo


def _load(photo: Photo) -> StressPhoto:
    if photo.mask is None or photo.px_per_mm is None:
        raise InputError(f"photo {photo.name} needs a mask and px_per_mm in its manifest")
    image, mask = load_photo_and_mask(photo)
    if mask is None or not mask.any():
        raise InputError(f"the mask of photo {photo.name} is empty; leave the photo out")
    return StressPhoto(
        image=image, mask=mask, area_cm2=photo.seen_cm2, px_per_mm=photo.px_per_mm, grid_mm=photo.grid_mm
    )


def _lay_over(photo: StressPhoto, nuisance: Nuisance, step: int, seeds: Sequence[int]) -> StressPhoto:
    assert nuisance.of_photo is not None
    # The same for all severities, so that only the severity differs.
    rng = np.random.default_rng([*seeds, zlib.crc32(nuisance.name.encode())])
    return nuisance.of_photo(photo, nuisance.severities[step], rng)
