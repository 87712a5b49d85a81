"""Parameters of the things beside the leaf."""

import math
from dataclasses import dataclass

from laesi_tf.synthesis.ranges import Number, Probability, late


@dataclass(frozen=True)
class PropsParams:
    """What lies in a scene; sizes in mm, directions and turns in radians, colours in HSV."""

    fragment: Number = Probability(0.16)
    fragment_mm: Number = (8, 40)
    fragment_aspect: Number = (0.4, 1.0)
    label: Number = Probability(0.2)
    label_mm: Number = (14, 45)
    label_aspect: Number = (0.3, 0.7)
    pen: Number = Probability(0.1)
    pen_mm: Number = (70, 150)
    pen_thickness_mm: Number = (6, 12)
    coin: Number = Probability(0.1)
    coin_mm: Number = (16, 26)
    handwriting: Number = Probability(0.25)
    handwriting_mm: Number = (8, 34)
    handwriting_height: Number = (0.12, 0.4)
    direction: Number = (-math.pi, math.pi)
    gap_mm: Number = (2, 30)
    turn: Number = (-math.pi, math.pi)
    hue: Number = (0.0, 1.0)
    saturation: Number = (0.0, 0.9)
    ink_value: Number = (0.05, 0.4)
    stroke_mm: Number = (0.3, 0.9)
    calibration: Number = late(Probability(0.0))
    calibration_mm: Number = late(20.0)
    """Side of the red square. Of 4 cm2, as Easy Leaf Area takes it to be, and the same in all pictures."""
    calibration_hue: Number = late((-0.02, 0.02))
    calibration_saturation: Number = late((0.75, 0.95))
    calibration_value: Number = late((0.65, 0.9))
