"""A picture of known area that nuisances are applied to."""

from dataclasses import dataclass

from laesi_tf.common.arrays import Mask, RgbImage


@dataclass(frozen=True, eq=False, kw_only=True)
class StressPhoto:
    """A picture, and what is true about it."""

    image: RgbImage
    """uint8 [H, W, 3]."""
    mask: Mask
    """bool [H, W], True on the leaf."""
    area_cm2: float
    """Of what is seen of the leaf."""
    px_per_mm: float
    """Scale at the leaf's centroid."""
    grid_mm: float | None = None
