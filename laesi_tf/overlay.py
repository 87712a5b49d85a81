"""Pictures for people: a photo with outlines and numbers drawn on it and lines of text below.

Pictures are uint8 [H, W, 3] RGB throughout.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from laesi_tf.files import whole

Colour = tuple[int, int, int]

# Neither colour is a leaf's, a ruling's or a common desk's; both hold on light and dark ground.
FOUND: Colour = (255, 0, 160)
TRUE: Colour = (0, 120, 255)
GRID: Colour = (0, 200, 255)
_MOST_LINES = 200

# Pillow's own font lacks the superscript of cm² and most of what file names are written in.
_FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"

# Wide enough to see a margin on a screen, and a fifth of a 12-megapixel photo's bytes.
SIDE = 1600


def outlined(
    image: np.ndarray, outlines: Sequence[tuple[np.ndarray, Colour]], *, side: int = SIDE
) -> np.ndarray:
    """`image` [H, W, 3] with its longer side brought to `side` pixels, and `outlines` on it.

    Each outline is [N, 2], (x, y) in the pixels of `image`.
    """
    scale = side / max(image.shape[:2])
    width, height = (max(1, round(length * scale)) for length in (image.shape[1], image.shape[0]))
    filter_ = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = cv2.resize(image, (width, height), interpolation=filter_)
    for outline, colour in outlines:
        # Sixteenths of a pixel; pixel centres move by half a pixel on scaling.
        points = np.round(((outline + 0.5) * scale - 0.5) * 16).astype(np.int32)
        cv2.polylines(picture, [points], True, colour, max(1, side // 400), cv2.LINE_AA, shift=4)
    return picture


def numbered(picture: np.ndarray, labels: Sequence[tuple[np.ndarray, str]]) -> np.ndarray:
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


def captioned(picture: np.ndarray, lines: Sequence[str]) -> np.ndarray:
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
        text, fitting = _fitted(line, font, width - 2 * margin)
        draw.text((margin, height + step // 6 + number * step), text, fill="black", font=fitting)
    return np.asarray(framed)


def gridded(image: np.ndarray, to_mm: np.ndarray, *, step_mm: float = 10.0) -> np.ndarray:
    """`image` [H, W, 3] with a square lattice of the sheet over it: its lines run and fan out as the ruling.

    `to_mm` [3, 3] takes pixels, their centres at halves, to mm on the sheet, up to translation.
    """
    height, width = image.shape[:2]
    corners = _mapped(to_mm, np.array([[0, 0], [width, 0], [width, height], [0, height]]))
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    drawn, thickness = image.copy(), max(1, max(height, width) // 900)
    for axis in (0, 1):
        for place in np.arange(box[0, axis], box[1, axis], step_mm)[:_MOST_LINES]:
            ends = box.copy()
            ends[:, axis] = place
            start, end = np.round(_mapped(np.linalg.inv(to_mm), ends) - 0.5).astype(int).tolist()
            cv2.line(drawn, start, end, GRID, thickness, cv2.LINE_AA)
    return drawn


def _mapped(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`points` [N, 2] through a homography [3, 3]."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]


def _fitted(line: str, font: ImageFont.FreeTypeFont, width: int) -> tuple[str, ImageFont.FreeTypeFont]:
    """`line` and a font that make `width` pixels at most: down to half the size, then without its end."""
    excess = font.getlength(line) / max(1, width)
    if excess <= 1:
        return line, font
    small = font.font_variant(size=font.size / min(excess * 1.02, 2.0))
    while len(line) > 1 and small.getlength(line) > width:
        line = f"{line[:-2]}…"
    return line, small


def sheet(pictures: Sequence[np.ndarray], *, columns: int = 4, gap: int = 12) -> np.ndarray:
    """`pictures`, each [h, w, 3] of any size, in rows of `columns` on white, at their own size."""
    height = max(picture.shape[0] for picture in pictures) + gap
    width = max(picture.shape[1] for picture in pictures) + gap
    rows = -(-len(pictures) // columns)
    canvas = np.full((rows * height + gap, min(columns, len(pictures)) * width + gap, 3), 255, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = gap + number // columns * height, gap + number % columns * width
        canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return canvas


def printable(text: object) -> str:
    """`text` with control characters and undecodable bytes replaced, fit for a terminal or a caption."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(text))


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write `picture` [H, W, 3] as PNG, whole or not at all. Raises InputError where it cannot."""
    with whole(path) as temporary:
        # Level 1 takes a third of the time of the default and a tenth more bytes.
        Image.fromarray(picture).save(temporary, format="PNG", compress_level=1)
