"""What a sample is: the dict of arrays that describes one image with its label.

image       uint8 [H, W, 3]     RGB, 0..255
mask        uint8 [H, W]        1 on the leaf, else 0; all 0 for a photo without a mask
area_cm2    float32 []          one-sided leaf area
px_per_mm   float32 []          scale at the leaf's centroid; NaN for a photo of unknown scale

Rendered samples have these as well:

tilt_deg    float32 []          angle between the camera's axis and the sheet's normal
to_px       float32 [3, 3]      homography from sheet coordinates in mm to pixels, without lens and bend
kind        int32 []            position of the leaf's kind in the ranges' `leaf`
index       int64 []            index of the sample
"""

from typing import Any

import tensorflow as tf
from numpy.typing import NDArray

Sample = dict[str, tf.Tensor]
"""A sample inside a tf.data pipeline."""
ArraySample = dict[str, NDArray[Any]]
"""A sample outside of one."""
COMMON_KEYS = ("image", "mask", "area_cm2", "px_per_mm")
"""Keys that every sample has, wherever it comes from."""
