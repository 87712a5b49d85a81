"""
One scene, component by component
=================================

Every component of a scene can be switched off by name, to see what it does, what it costs and what it is
worth.
"""

import matplotlib.pyplot as plt

from laesi_tf.synthesis import COMPONENTS, load_ranges, synthesise

print(", ".join(COMPONENTS))

# %%
# The same scene with more and more of them. In a TOML file for ``--ranges`` the line ``without = [...]``
# names those that are left out.

added = {
    "leaf and sheet": [],
    "ruling": ["ruling"],
    "surface": ["surface", "veins", "undulation", "relief"],
    "light": ["shadow", "illumination"],
    "everything": COMPONENTS,
}
figure, row = plt.subplots(1, len(added), figsize=(10, 2.3), layout="constrained")
shown: set[str] = set()
for axes, (title, names) in zip(row, added.items(), strict=True):
    shown |= set(names)
    without = [name for name in COMPONENTS if name not in shown]
    ranges = load_ranges({"without": without, "lighting_passes": 1})
    axes.imshow(synthesise(seed=11, size=(224, 224), ranges=ranges, index=0)["image"])
    axes.set_title(f"+ {title}" if names else title)
    axes.set_axis_off()
