"""
Measure a photo
===============

The shipped networks find the leaf, the ruling gives the scale. The photo is the sample of the README, a
synthetic one whose area is known.
"""

import csv
from pathlib import Path

import matplotlib.pyplot as plt

from laesi_tf.data.decoding import decode_photo
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.reporting.overlay import draw_grid, draw_outlines

folder = Path("../sample")
image = decode_photo(folder / "leaf.jpg")
estimator = load_estimator()
measurement = estimator.measure(image)
with (folder / "manifest.csv").open() as file:
    true_cm2 = float(next(csv.DictReader(file))["area_cm2"])

leaf = measurement.leaves[0]
print(f"measured {leaf.area_cm2:.2f} ± {leaf.uncertainty_cm2:.2f} cm², true {true_cm2:.2f} cm²")
print(f"{leaf.length_mm:.1f} × {leaf.width_mm:.1f} mm at {leaf.px_per_mm:.2f} px/mm")
print(f"tilt {measurement.tilt_deg:.0f}°, method: {measurement.method}")

# %%
# ``camera`` is what was fitted to the ruling. Every tenth line that it predicts must lie on a printed one.

overlay = draw_grid(image, measurement.camera)
overlay = draw_outlines(overlay, [(leaf.outline, (255, 0, 170))])
figure, axes = plt.subplots(figsize=(8, 6), layout="constrained")
axes.imshow(overlay)
axes.set_axis_off()
