"""Parameters of the camera."""

import math
from dataclasses import dataclass
from typing import Generic

from laesi_tf.synthesis.ranges import Value, constant, interval, probability


@dataclass(frozen=True)
class CameraParams(Generic[Value]):
    """A phone held over the sheet."""

    fill: Value = interval(0.25, 0.86)
    """Longer side of the leaf's bounding box over the image's side, before the limits of the view."""
    closest_mm: Value = constant(70)
    farthest_mm: Value = constant(230)
    """Limits of the field of view: width of the sheet seen at the leaf."""
    tilted: Value = probability(0.6)
    tilt_deg: Value = interval(0, 20)
    tilt_direction: Value = interval(-math.pi, math.pi)
    roll: Value = interval(-math.pi, math.pi)
    focal: Value = interval(0.9, 1.6)
    """Focal length in image widths."""
    place_x: Value = interval(0.0, 1.0)
    place_y: Value = interval(0.0, 1.0)
    """Position of the leaf's bounding box in the image: 0 at one border, 1 at the other."""
    blurred: Value = probability(0.5)
    blur_mm: Value = interval(0.03, 0.25)
    """Standard deviation of the focus blur, mm on the sheet, of a Gaussian that is cut off at 1.25 standard
    deviations of the widest blur."""
    noise: Value = interval(0.0, 0.025)
    """Standard deviation of sensor noise: 1.25 times this in the shadows, half of that in the highlights.
    Little remains in a photo that is shrunk."""
    warmth: Value = interval(-0.2, 0.2)
    """White balance: gain of red relative to blue."""
    green: Value = interval(-0.06, 0.06)
    exposure: Value = interval(0.65, 1.06)
    """Level of the brightest channel of bare paper: phones seldom overexpose what fills the image."""
    contrast: Value = interval(0.85, 1.2)
    saturation: Value = interval(0.75, 1.3)
    compressed: Value = probability(0.35)
    """JPEG halves the resolution of colour."""
    distorted: Value = probability(0.0)
    k1: Value = interval(-0.05, 0.05)
    """Radial distortion, per squared half of the photo's longer side; above zero: barrel."""
    lens_x: Value = interval(-0.2, 0.2)
    lens_y: Value = interval(-0.2, 0.2)
    """Centre of the distortion from the photo's middle, in half its longer side: people crop photos."""
    bent: Value = probability(0.0)
    """The sheet is a part of a cylinder."""
    bend: Value = interval(-0.03, 0.03)
    """Its height half the photo's longer side away from the middle, in distances of the camera."""
    bend_angle: Value = interval(-math.pi, math.pi)
    sharpened: Value = probability(0.0)
    sharpening: Value = interval(0.3, 1.5)
    """Strength of the unsharp mask."""
    sharpening_px: Value = interval(0.5, 2.0)
    resized: Value = probability(0.0)
    resize_factor: Value = interval(0.5, 1.6)
    """Side of the file's image over that of the result, to which it is resized."""
    is_jpeg: Value = probability(0.0)
    jpeg_quality: Value = interval(25, 98)
