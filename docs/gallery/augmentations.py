"""
Augment a sample
================

The paper's nine augmentations, each applied alone. Geometric ones move the mask and the scale with the
image; the area stays what it is.
"""

import matplotlib.pyplot as plt
import tensorflow as tf

from laesi_tf.data.augmentation import AUGMENTATIONS, augment_sample, augmentation_flags
from laesi_tf.synthesis import synthesise

sample = synthesise(seed=11, size=(224, 224), ranges="rendering_2", index=6)
augmented = {"original": sample}
for name in AUGMENTATIONS:
    flags = tf.constant(augmentation_flags([name]))
    augmented[name] = augment_sample(sample, tf.constant([5, 1]), flags)

figure, grid = plt.subplots(2, 5, figsize=(10, 4.4), layout="constrained")
for axes, (name, result) in zip(grid.flat, augmented.items(), strict=True):
    axes.imshow(result["image"])
    axes.contour(result["mask"], [0.5], colors="magenta", linewidths=0.8)
    axes.set_title(name)
    axes.set_axis_off()

# %%
# A rotation by any angle shrinks the picture, so that no part of the leaf is cut off. The scale follows:

before, after = sample["px_per_mm"], augmented["rotation"]["px_per_mm"]
print(f"{before:.2f} px/mm before, {after:.2f} px/mm after the rotation")
