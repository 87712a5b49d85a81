"""Measure a photo at fewer pixels: any estimator on the photo shrunk to a working size."""

import dataclasses

import cv2
import numpy as np

from laesi_tf.common.arrays import Points, RgbImage
from laesi_tf.estimators.base import UNKNOWN, Estimator, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.photo_pyramid import PhotoPyramid, shrink


class ReducedPhoto:
    """Measures with another estimator what it sees at a working size, and reports in photo pixels."""

    def __init__(self, estimator: Estimator, side_px: int) -> None:
        """Take an estimator and the longer side of the photos that it shall see."""
        self._estimator = estimator
        self._side_px = side_px

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`."""
        small = shrink(PhotoPyramid(image).photo, self._side_px)
        if small.image is image:
            return self._estimator.measure(image, info)
        step = float(np.sqrt(small.pixel_size.prod()))
        known = None if info.px_per_mm is None else info.px_per_mm / step
        measured = self._estimator.measure(small.image, dataclasses.replace(info, px_per_mm=known))
        camera, mask = measured.camera, measured.mask
        if camera is not None:
            x, y = small.pixel_size
            step_x, step_y = camera.step
            left, top = camera.origin
            camera = dataclasses.replace(
                camera,
                step=(step_x * float(x), step_y * float(y)),
                origin=(left * float(x), top * float(y)),
            )
        if mask is not None:
            size = image.shape[1], image.shape[0]
            mask = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        leaves = tuple(_enlarge_leaf(leaf, small.pixel_size, step) for leaf in measured.leaves)
        return dataclasses.replace(measured, leaves=leaves, camera=camera, mask=mask)


def _enlarge_leaf(leaf: LeafMeasurement, pixel_size: Points, step: float) -> LeafMeasurement:
    return dataclasses.replace(
        leaf,
        px_per_mm=None if leaf.px_per_mm is None else leaf.px_per_mm * step,
        outline=None if leaf.outline is None else leaf.outline * pixel_size,
        holes=tuple(hole * pixel_size for hole in leaf.holes),
    )
