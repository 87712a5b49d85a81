"""Parameters of the things beside the leaf."""

import math
from dataclasses import dataclass
from typing import Generic

from laesi_tf.synthesis.ranges import Value, constant, interval, late, probability


@dataclass(frozen=True)
class PropsParams(Generic[Value]):
    """What lies in a scene; sizes in mm, directions and turns in radians, colours in HSV."""

    fragment: Value = probability(0.16)
    fragment_mm: Value = interval(8, 40)
    fragment_aspect: Value = interval(0.4, 1.0)
    label: Value = probability(0.2)
    label_mm: Value = interval(14, 45)
    label_aspect: Value = interval(0.3, 0.7)
    pen: Value = probability(0.1)
    pen_mm: Value = interval(70, 150)
    pen_thickness_mm: Value = interval(6, 12)
    coin: Value = probability(0.1)
    coin_mm: Value = interval(16, 26)
    handwriting: Value = probability(0.25)
    handwriting_mm: Value = interval(8, 34)
    handwriting_height: Value = interval(0.12, 0.4)
    direction: Value = interval(-math.pi, math.pi)
    gap_mm: Value = interval(2, 30)
    turn: Value = interval(-math.pi, math.pi)
    hue: Value = interval(0.0, 1.0)
    saturation: Value = interval(0.0, 0.9)
    ink_value: Value = interval(0.05, 0.4)
    stroke_mm: Value = interval(0.3, 0.9)
    calibration: Value = late(probability(0.0))
    calibration_mm: Value = late(constant(20.0))
    """Side of the red square. Of 4 cm2, as Easy Leaf Area takes it to be, and the same in all pictures."""
    calibration_hue: Value = late(interval(-0.02, 0.02))
    calibration_saturation: Value = late(interval(0.75, 0.95))
    calibration_value: Value = late(interval(0.65, 0.9))
