"""Colour threshold: the excess green of each pixel, Otsu's threshold, the largest piece, a given scale.

What users of ImageJ and PlantCV do by hand. Excess green is that of Woebbecke et al. (1995), "Color indices
for weed identification under various soil, residue, and lighting conditions", Transactions of the ASAE 38(1),
259-269: 2g - r - b of the shares r, g, b of a pixel's colour.
"""

import cv2
import numpy as np

from laesi_tf.common.arrays import FloatMap, RgbImage
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.estimators.base import UNKNOWN, LeafMeasurement, Measurement, PhotoInfo
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.estimators.photo_pyramid import PhotoPyramid

METHOD = "excess green x given scale"
_NO_SCALE = "a colour threshold reads no scale; give it with --px-per-mm (in a manifest: column px_per_mm)"


class ColourThreshold:
    """Measures the largest green piece of a photo; nothing is learned and nothing is set."""

    def measure(self, image: RgbImage, info: PhotoInfo = UNKNOWN) -> Measurement:
        """Measure as `Estimator.measure`; refuses where no scale is given."""
        if info.px_per_mm is None:
            return Measurement(method=METHOD, refusal=_NO_SCALE)
        pyramid = PhotoPyramid(image)
        overview = pyramid.overview
        greenness = compute_excess_green(overview.image)
        levels = cv2.normalize(greenness, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
        _, green = cv2.threshold(levels, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(green, connectivity=4)
        if len(boxes) == 1:
            return Measurement(method=METHOD, refusal=NO_LEAF)
        piece = labels == 1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))
        pixels = float(np.count_nonzero(piece) * np.prod(overview.pixel_size))
        leaf = LeafMeasurement(
            area_cm2=pixels / info.px_per_mm**2 / 100,
            px_per_mm=info.px_per_mm,
            outline=np.clip(overview.to_photo(trace_polygons(piece)[0].outer), 0, pyramid.size.xy),
        )
        size = pyramid.size.width, pyramid.size.height
        mask = cv2.resize(piece.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        return Measurement(method=METHOD, leaves=(leaf,), mask=mask)


def compute_excess_green(image: RgbImage) -> FloatMap:
    """Return the excess green, float32 [h, w] in -1..2, of an image, uint8 [h, w, 3]; 0 where it is black."""
    colour = image.astype(np.float32)
    total = colour.sum(axis=-1)
    # 2g - r - b = 3g - 1 as the shares sum to one.
    return np.divide(3 * colour[..., 1], total, out=np.ones_like(total), where=total > 0) - 1
