"""Text on images: numbers, captions below, contact sheets.

Images are uint8 [H, W, 3] RGB throughout.
"""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

# Pillow's own font lacks the superscript of cm² and most of what file names are written in.
_FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"


def draw_labels(picture: np.ndarray, labels: Sequence[tuple[np.ndarray, str]]) -> np.ndarray:
    """`picture` [H, W, 3] with short texts centred on points (x, y), readable on any ground.

    The letters are a fiftieth of the longer side high.
    """
    size = max(10.0, max(picture.shape[:2]) / 50)
    font = ImageFont.truetype(_FONT, size)
    labelled = Image.fromarray(picture)
    draw = ImageDraw.Draw(labelled)
    for (x, y), text in labels:
        draw.text(
            (x, y),
            text,
            "white",
            font,
            anchor="mm",
            stroke_width=max(1, round(size / 8)),
            stroke_fill="black",
        )
    return np.asarray(labelled)


def add_caption(picture: np.ndarray, lines: Sequence[str]) -> np.ndarray:
    """`picture` [H, W, 3] with `lines` of text in a strip below, where they hide nothing.

    The letters are a thirtieth of the longer side high; a line that would not fit is set smaller, then cut.
    """
    height, width = picture.shape[:2]
    font = ImageFont.truetype(_FONT, max(10.0, max(height, width) / 30))
    step = round(font.size * 1.4)
    framed = Image.new("RGB", (width, height + step * len(lines) + step // 3), "white")
    framed.paste(Image.fromarray(picture), (0, 0))
    draw = ImageDraw.Draw(framed)
    margin = width // 50
    for number, line in enumerate(lines):
        text, fitting = _shorten_to_width(line, font, width - 2 * margin)
        draw.text((margin, height + step // 6 + number * step), text, fill="black", font=fitting)
    return np.asarray(framed)


def _shorten_to_width(
    line: str, font: ImageFont.FreeTypeFont, width: int
) -> tuple[str, ImageFont.FreeTypeFont]:
    """`line` and a font that make `width` pixels at most: down to half the size, then without its end."""
    excess = font.getlength(line) / max(1, width)
    if excess <= 1:
        return line, font
    small = font.font_variant(size=font.size / min(excess * 1.02, 2.0))
    while len(line) > 1 and small.getlength(line) > width:
        line = f"{line[:-2]}…"
    return line, small


def make_contact_sheet(pictures: Sequence[np.ndarray], *, columns: int = 4, gap: int = 12) -> np.ndarray:
    """`pictures`, each [h, w, 3] of any size, in rows of `columns` on white, at their own size."""
    height = max(picture.shape[0] for picture in pictures) + gap
    width = max(picture.shape[1] for picture in pictures) + gap
    rows = -(-len(pictures) // columns)
    canvas = np.full((rows * height + gap, min(columns, len(pictures)) * width + gap, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = gap + number // columns * height, gap + number % columns * width
        canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return canvas
