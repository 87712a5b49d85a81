"""
Render a scene with its mask and label
======================================

``synthesise`` turns a seed and an index into one synthetic photo. The same numbers give the same picture on
every machine, eagerly or inside tf.data.
"""

import matplotlib.pyplot as plt

from laesi_tf.synthesis import synthesise

sample = synthesise(seed=11, size=(224, 224), ranges="rendering_2", index=6)
for name, value in sample.items():
    print(f"{name:<10} {value.dtype.name:<8} {value.shape}")

# %%
# ``area_cm2`` is the label that a network learns: the flat one-sided area with holes subtracted and the
# petiole included. ``px_per_mm`` is the scale at the leaf, ``tilt_deg`` the angle of the camera. The mask
# is filled from the polygon whose area is the label.

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
left.imshow(sample["image"])
left.set_title("{area_cm2:.2f} cm², {px_per_mm:.2f} px/mm, tilt {tilt_deg:.0f}°".format_map(sample))
right.imshow(sample["mask"], cmap="gray")
right.set_title("mask")
for axes in (left, right):
    axes.set_axis_off()

# %%
# ``to_px`` is the homography from millimetres on the sheet to pixels. At the leaf's centroid, the square
# root of its Jacobian's determinant is the scale.

print(sample["to_px"].numpy().round(3))
