"""
Undo the tilt by the ruling
===========================

On a tilted sheet the scale changes across the photo. The ruling shows by how much: here the sample photo is
warped as if the sheet had been turned about the leaf, and the measured area hardly changes.
"""

from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

from laesi_tf.data.decoding import decode_photo
from laesi_tf.estimators.factory import load_estimator

image = decode_photo(Path("../sample/leaf.jpg"))
height, width = image.shape[:2]
estimator = load_estimator()
leaf = estimator.measure(image).leaves[0]
centre = leaf.outline.mean(axis=0)


def turn_sheet(degrees: float) -> np.ndarray:
    """Return the homography [3, 3] of pixels that turns the sheet about the leaf."""
    angle = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), 0], [0, -np.sin(angle) / width, 1]])
    shift = np.array([[1, 0, centre[0]], [0, 1, centre[1]], [0, 0, 1]])
    return shift @ turn @ np.linalg.inv(shift)


# %%
# The photo itself is tilted, so one turn adds to its tilt and the other reduces it.

figure, row = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for axes, degrees in zip(row, (-15.0, 0.0, 15.0), strict=True):
    turned = cv2.warpPerspective(image, turn_sheet(degrees), (width, height), borderValue=(120, 120, 120))
    measurement = estimator.measure(turned)
    leaf = measurement.leaves[0]
    print(
        f"turned by {degrees:+3.0f}°: tilt {measurement.tilt_deg:4.1f}°, "
        f"{leaf.px_per_mm:.2f} px/mm at the leaf, {leaf.area_cm2:.2f} ± {leaf.uncertainty_cm2:.2f} cm²"
    )
    axes.imshow(turned)
    axes.set_title(f"tilt {measurement.tilt_deg:.0f}°, {leaf.area_cm2:.2f} cm²")
    axes.set_axis_off()
