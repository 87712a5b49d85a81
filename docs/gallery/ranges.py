"""
Change what scenes show
=======================

Scenes are sampled from ranges. A table in the format of the TOML files of ``--ranges`` changes any of them;
everything else stays as in the preset it starts from.
"""

import matplotlib.pyplot as plt

from laesi_tf.common.errors import InputError
from laesi_tf.synthesis import load_ranges, synthesise

ranges = {
    "rendering_2": load_ranges("rendering_2"),
    "greenish paper": load_ranges({"paper": {"tinted": {"chance": 1.0}, "hue": [0.3, 0.4]}}),
    "always a coin and a pen": load_ranges({"props": {"coin": {"chance": 1.0}, "pen": {"chance": 1.0}}}),
}
figure, rows = plt.subplots(len(ranges), 4, figsize=(8.6, 6.6), layout="constrained")
for row, (name, chosen) in zip(rows, ranges.items(), strict=True):
    for index, axes in enumerate(row):
        sample = synthesise(seed=3, size=(224, 224), ranges=chosen.with_passes(1), index=index)
        axes.imshow(sample["image"])
        axes.set_axis_off()
    row[0].set_title(name, loc="left")

# %%
# An unknown key is refused with the nearest known one.

try:
    load_ranges({"paper": {"hue_": [0.3, 0.4]}})
except InputError as error:
    print(error)
