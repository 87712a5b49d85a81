"""Text on images: numbers, captions below, contact sheets.

Images are uint8 [H, W, 3] RGB throughout.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from laesi_tf.common.arrays import Points, RgbImage

# Pillow's own font lacks the superscript of cm² and most scripts of file names.
_FONT = Path(__file__).with_name("fonts") / "DejaVuSans.ttf"
_MIN_FONT_PX = 10.0


def draw_labels(
    image: RgbImage, labels: Sequence[tuple[Points, str]], *, max_height: float = math.inf
) -> RgbImage:
    """Return `image` [H, W, 3] with short texts centred on points (x, y), readable on any background.

    The letters are a fiftieth of the longer side high, and at most `max_height` pixels.
    """
    size = max(_MIN_FONT_PX, min(max(image.shape[:2]) / 50, max_height))
    font = ImageFont.truetype(_FONT, size)
    labelled = Image.fromarray(image)
    draw = ImageDraw.Draw(labelled)
    outline = {"stroke_width": max(1, round(size / 8)), "stroke_fill": "black"}
    for (x, y), text in labels:
        draw.text((x, y), text, "white", font, anchor="mm", **outline)
    return np.asarray(labelled)


def add_caption(image: RgbImage, lines: Sequence[str]) -> RgbImage:
    """Return `image` [H, W, 3] with `lines` of text in a white strip below it.

    The letters are a thirtieth of the longer side high; a line that is too long is set smaller, then cut.
    """
    height, width = image.shape[:2]
    font = ImageFont.truetype(_FONT, max(_MIN_FONT_PX, max(height, width) / 30))
    line_height = round(font.size * 1.4)
    captioned = Image.new("RGB", (width, height + line_height * len(lines) + line_height // 3), "white")
    captioned.paste(Image.fromarray(image), (0, 0))
    draw = ImageDraw.Draw(captioned)
    padding = width // 50
    for number, line in enumerate(lines):
        text, fitting = _shorten_to_width(line, font, width - 2 * padding)
        top = height + line_height // 6 + number * line_height
        draw.text((padding, top), text, fill="black", font=fitting)
    return np.asarray(captioned)


def make_contact_sheet(images: Sequence[RgbImage], *, columns: int = 4, gap: int = 12) -> RgbImage:
    """Arrange `images`, each [h, w, 3] of any size, in rows of `columns` on white, at their own size."""
    height = max(image.shape[0] for image in images) + gap
    width = max(image.shape[1] for image in images) + gap
    rows = -(-len(images) // columns)
    sheet = np.full((rows * height + gap, min(columns, len(images)) * width + gap, 3), 255, np.uint8)
    for number, image in enumerate(images):
        top, left = gap + number // columns * height, gap + number % columns * width
        sheet[top : top + image.shape[0], left : left + image.shape[1]] = image
    return sheet


def _shorten_to_width(
    line: str, font: ImageFont.FreeTypeFont, width: int
) -> tuple[str, ImageFont.FreeTypeFont]:
    """Return text and font of at most `width` pixels: down to half the size, then without its end."""
    excess = font.getlength(line) / max(1, width)
    if excess <= 1:
        return line, font
    small = font.font_variant(size=font.size / min(excess * 1.02, 2.0))
    while len(line) > 1 and small.getlength(line) > width:
        line = f"{line[:-2]}…"
    return line, small
