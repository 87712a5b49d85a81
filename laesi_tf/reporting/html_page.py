"""Pieces of HTML pages that open without a server: their head, and images inside the file."""

import base64
import html
import io
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image

from laesi_tf.common.arrays import RgbImage
from laesi_tf.common.text import sanitise_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def escape(text: str) -> str:
    """Return text, such as a file's name, as HTML."""
    return html.escape(sanitise_text(text))


def begin_page(title: str, style: str) -> str:
    """Return a page up to its first heading, which is the title; `</body></html>` ends it."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>\n<h1>{escape(title)}</h1>\n"
    )


def encode_jpeg(image: RgbImage, quality: int) -> str:
    """Return `image`, uint8 [H, W, 3], as a JPEG in base64."""
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, encoded = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), flags)
    return base64.b64encode(encoded.tobytes()).decode("ascii")


def encode_figure(figure: "Figure", *, dpi: int, colours: int | None = None) -> str:
    """Return a chart as a PNG in base64; of so many `colours`, it takes a fraction of the bytes."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi)
    if colours is not None:
        reduced = Image.open(drawn).convert("RGB").quantize(colours)
        drawn = io.BytesIO()
        reduced.save(drawn, format="PNG", optimize=True)
    return base64.b64encode(drawn.getvalue()).decode("ascii")


def show_jpeg(encoded: str) -> str:
    """Return the element of a JPEG in base64, which its caption describes."""
    return f"<img alt='' src='data:image/jpeg;base64,{encoded}'>"


def show_png(encoded: str, description: str = "") -> str:
    """Return the element of a PNG in base64."""
    return f"<img alt='{html.escape(description)}' src='data:image/png;base64,{encoded}'>"
