"""Parameters of the camera."""

import math
from dataclasses import dataclass

from laesi_tf.synthesis.ranges import Number, Probability


@dataclass(frozen=True)
class CameraParams:
    """A phone held over the sheet."""

    fill: Number = (0.25, 0.86)
    """Longer side of the leaf's bounding box over the picture's side, before the limits of the view."""
    closest_mm: Number = 70
    farthest_mm: Number = 230
    """Limits of the field of view: width of the sheet seen at the leaf."""
    tilted: Number = Probability(0.6)
    tilt_deg: Number = (0, 20)
    tilt_direction: Number = (-math.pi, math.pi)
    roll: Number = (-math.pi, math.pi)
    focal: Number = (0.9, 1.6)
    """Focal length in picture widths."""
    place_x: Number = (0.0, 1.0)
    place_y: Number = (0.0, 1.0)
    """Where the leaf's bounding box lies in the frame: 0 at one border, 1 at the other."""
    blurred: Number = Probability(0.5)
    blur_mm: Number = (0.03, 0.25)
    """Spread of the focus blur, mm on the sheet: that of a Gaussian whose tails are cut off where that of the
    widest is at 1.25 of its standard deviations."""
    noise: Number = (0.0, 0.025)
    """Standard deviation: 1.25 times this in the shadows, half of that in the lights. A photo that is shrunk
    keeps little."""
    warmth: Number = (-0.2, 0.2)
    """White balance: gain of red against blue."""
    green: Number = (-0.06, 0.06)
    exposure: Number = (0.65, 1.06)
    """Where the exposure meter puts the brightest channel of bare paper: phones seldom bleach what fills the
    frame."""
    contrast: Number = (0.85, 1.2)
    saturation: Number = (0.75, 1.3)
    compressed: Number = Probability(0.35)
    """JPEG halves the resolution of colour."""
