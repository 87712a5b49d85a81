"""Render leaf.jpg, a synthetic photo of known area, and its manifest: `python docs/sample/make_leaf.py`.

Another version of the renderer makes another picture; tests/test_documentation.py then needs the new figures.
"""

import csv
from pathlib import Path

from PIL import Image

from laesi_tf.synthesis import load_ranges, synthesise

FOLDER = Path(__file__).parent
SEED, INDEX = 11, 19
SIZE = 768, 1024


def main() -> None:
    """Write leaf.jpg and manifest.csv beside this file."""
    ranges = load_ranges({"lighting_passes": 1, "camera": {"fill": [0.35, 0.55]}})
    sample = synthesise(SEED, size=SIZE, ranges=ranges, index=INDEX)
    Image.fromarray(sample["image"].numpy()).save(FOLDER / "leaf.jpg", quality=80)
    with (FOLDER / "manifest.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["image", "area_cm2"])
        writer.writerow(["leaf.jpg", f"{float(sample['area_cm2']):.4f}"])


if __name__ == "__main__":
    main()
