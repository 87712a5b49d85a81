"""Make the images of the documentation from what the commands write: `python docs/make_images.py`.

scenes.jpg and components.jpg come from `laesi preview`, overlay.jpg from `laesi predict` of sample/leaf.jpg.
"""

import tempfile
from pathlib import Path

from PIL import Image

from laesi_tf import predict, preview

DOCS = Path(__file__).parent
WIDTH_PX = 1400


def main() -> None:
    """Write the three images beside this file."""
    with tempfile.TemporaryDirectory() as folder:
        preview.main(["--out", folder])
        predict.main([str(DOCS / "sample" / "leaf.jpg"), "--out", folder])
        for source, name in (("scenes", "scenes"), ("components", "components"), ("leaf.overlay", "overlay")):
            image = Image.open(Path(folder) / f"{source}.png").convert("RGB")
            image.thumbnail((WIDTH_PX, WIDTH_PX))
            image.save(DOCS / f"{name}.jpg", quality=85, optimize=True)


if __name__ == "__main__":
    main()
