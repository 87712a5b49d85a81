"""Drawn photos of leaves with veins on ruled paper, with masks and a manifest."""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

PAPER, LEAF, VEIN = (235, 235, 225), (60, 140, 50), (170, 200, 90)


def draw_leaf(
    *, length: float = 120, width: float = 60, angle: float = 0.0, side: int = 200, hue: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return image uint8 [side, side, 3] and mask bool: an oval blade, its midrib, and a petiole at its base.

    The base points to the left at `angle` 0 degrees, and turns clockwise. `hue` is added to the red channel.
    """
    image = draw_paper(side)
    mask = np.zeros((side, side), np.uint8)
    middle = (side // 2, side // 2)
    cv2.ellipse(mask, middle, (round(length / 2), round(width / 2)), angle, 0, 360, 1, cv2.FILLED)
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    base, tip = (np.rint(middle + sign * direction * length / 2).astype(int) for sign in (-1, 1))
    stalk = np.rint(middle - direction * length * 0.65).astype(int)
    cv2.line(mask, base.tolist(), stalk.tolist(), 1, 3)
    colour = np.add(LEAF, (hue, 0, 0))
    # The blade becomes brighter towards its tip.
    rows, columns = np.mgrid[:side, :side]
    along = ((columns - middle[0]) * direction[0] + (rows - middle[1]) * direction[1]) / length
    image[mask > 0] = (colour + 60 * along[..., None])[mask > 0].clip(0, 255).astype(np.uint8)
    cv2.line(image, stalk.tolist(), tip.tolist(), VEIN, 2)
    return image, mask > 0


def draw_paper(side: int) -> np.ndarray:
    """Return ruled paper, uint8 [side, side, 3]: a line every 8 pixels."""
    image = np.full((side, side, 3), PAPER, np.uint8)
    image[::8] = image[:, ::8] = (150, 170, 150)
    return image


def save_photos(folder: Path) -> Path:
    """Save photos of leaves of several shapes, one of them in split `test`; return the folder."""
    (folder / "masks").mkdir(parents=True)
    lines = ["image,area_cm2,mask,split"]
    for number, (width, hue) in enumerate([(30, 0), (60, 40), (90, 80), (60, 120)]):
        image, mask = draw_leaf(width=width, hue=hue, angle=40 * number)
        Image.fromarray(image).save(folder / f"{number}.png")
        Image.fromarray(mask).save(folder / "masks" / f"{number}.png")
        lines.append(f"{number}.png,10,masks/{number}.png,{'test' if number == 3 else 'train'}")
    (folder / "manifest.csv").write_text("\n".join(lines))
    return folder
