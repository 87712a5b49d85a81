"""Photographs of printed sheets, drawn by ray casting, and what a perfect network would say about their
cells."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from laesi_tf.models import ruling_cells as cells

FINER = 2


@dataclass(frozen=True)
class View:
    """A camera over a sheet: all that places lines in the photo."""

    height: int = 512
    width: int = 640
    px_per_mm: float = 5.0
    turn: float = 0.2
    tilt: tuple[float, float] = (0.0, 0.0)
    """Radians about the photo's x and y axes."""
    focal: float = 1.5
    """In half the photo's longer side."""
    k1: float = 0.0
    bow: float = 0.0
    """Rise in mm, 50 mm from the sheet's middle, of paper bent into a parabola."""
    stretch: float = 1.0
    """Pixels per mm across over down."""

    def to_sheet(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Millimetres along the two families of lines at photo pixels."""
        unit = max(self.height, self.width) / 2
        px, py = (x - self.width / 2) / unit / self.stretch, (y - self.height / 2) / unit
        stretch = 1 + self.k1 * (px**2 + py**2)
        ray = np.stack([px * stretch / self.focal, py * stretch / self.focal, np.ones_like(px)])
        a, b = self.tilt
        about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
        about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
        rotation = about_x @ about_y
        distance = self.focal * unit / self.px_per_mm
        ray, centre = np.einsum("ij,j...->i...", rotation, ray), rotation @ [0.0, 0.0, -distance]
        rise = np.zeros_like(x, float)
        for _ in range(8 if self.bow else 1):
            far = (-rise - centre[2]) / ray[2]
            across, down = centre[0] + far * ray[0], centre[1] + far * ray[1]
            rise = self.bow * (across / 50) ** 2
        slope = self.bow / 50**2
        across = across + 2 / 3 * slope**2 * across**3
        c, s = math.cos(self.turn), math.sin(self.turn)
        return c * across + s * down + 3.3, c * down - s * across - 1.7

    def density(self, points: np.ndarray) -> np.ndarray:
        """Square millimetres per pixel at `points` [N, 2]."""
        x, y = points.T
        h = 0.25
        right, left = self.to_sheet(x + h, y), self.to_sheet(x - h, y)
        below, above = self.to_sheet(x, y + h), self.to_sheet(x, y - h)
        ux, vx = ((p - q) / (2 * h) for p, q in zip(right, left, strict=True))
        uy, vy = ((p - q) / (2 * h) for p, q in zip(below, above, strict=True))
        return np.abs(ux * vy - uy * vx)


def draw_lines(position: np.ndarray, levels: dict[float, float], width_mm: float) -> np.ndarray:
    """Ink 0..1 of lines at multiples of each level's distance with its strength."""
    ink = np.zeros_like(position)
    for pitch, strength in levels.items():
        distance = np.abs(position - pitch * np.round(position / pitch))
        ink = np.maximum(ink, strength * np.exp(-((distance / width_mm) ** 2)))
    return ink


def draw_photo(
    view: View,
    levels: dict[float, float],
    *,
    families: int = 2,
    half_mm: float = 1e9,
    blur: float = 0.0,
    noise: float = 3.0,
    quality: int | None = None,
    width_mm: float = 0.1,
) -> np.ndarray:
    """A photo, float32 [h, w, 3] in 0..255; the sheet reaches `half_mm` from its middle, on a dark desk."""
    y, x = (np.mgrid[: view.height * FINER, : view.width * FINER] + 0.5) / FINER
    u, v = view.to_sheet(x, y)
    ink = draw_lines(u, levels, width_mm)
    if families == 2:
        ink = np.maximum(ink, draw_lines(v, levels, width_mm))
    colour = np.array([235.0, 232, 225]) - ink[..., None] * np.array([40.0, 120, 110])
    colour = np.where((np.maximum(np.abs(u), np.abs(v)) < half_mm)[..., None], colour, [70.0, 55, 40])
    small = colour.reshape(view.height, FINER, view.width, FINER, 3).mean((1, 3)).astype(np.float32)
    if blur:
        small = cv2.GaussianBlur(small, (0, 0), blur)
    small = small + np.random.default_rng(0).normal(0, noise, small.shape)
    small = np.clip(np.round(small), 0, 255)
    if quality:
        coded = cv2.imencode(".jpg", small.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        small = cv2.imdecode(coded, cv2.IMREAD_COLOR)
    return small.astype(np.float32)


def put_in_frame(photo: np.ndarray) -> np.ndarray:
    """The photo in the corner of the frame that the fit takes."""
    frame = np.zeros((cells.FRAME_PX, cells.FRAME_PX, 3), np.float32)
    frame[: photo.shape[0], : photo.shape[1]] = photo
    return frame


def answer_cells(
    view: View, pitch_mm: float, *, half_mm: float = 1e9, seed: int = 0
) -> list[cells.CellAnswers]:
    """What a network says that reads lines `pitch_mm` apart, one bin off at random."""
    random, answers = np.random.default_rng(seed), []
    for level in range(cells.LEVELS):
        side, step = cells.FRAME_CELLS >> level, cells.CELL_PX << level
        y, x = (np.mgrid[:side, :side] + 0.5) * step
        x, y = np.minimum(x, 2 * view.width), np.minimum(y, 2 * view.height)
        points = np.stack([x.ravel(), y.ravel()], 1)
        u, v = view.to_sheet(x, y)
        du, dv = (np.subtract(*(view.to_sheet(x + s, y)[i] for s in (0.5, -0.5))) for i in (0, 1))
        eu = np.subtract(*(view.to_sheet(x, y + s)[0] for s in (0.5, -0.5)))
        ev = np.subtract(*(view.to_sheet(x, y + s)[1] for s in (0.5, -0.5)))
        turn = np.exp(4j * np.arctan2(eu, du)) + np.exp(4j * np.arctan2(ev, dv))
        density = np.maximum(view.density(points), 1e-9).reshape(side, side)
        period = pitch_mm / np.sqrt(density) / 2**level
        bins = np.log(period / cells.FINEST_PX) / cells.LOG_STEP + random.uniform(-1, 1, period.shape)
        seen = (bins > 0) & (bins < cells.PERIOD_BINS - 1) & (x < view.width) & (y < view.height)
        seen &= np.maximum(np.abs(u), np.abs(v)) < half_mm
        place = np.clip(bins, 0, cells.PERIOD_BINS - 1)[..., None]
        periods = np.maximum(0, 1 - np.abs(np.arange(cells.PERIOD_BINS) - place))
        around = np.mod(np.angle(turn) / (2 * np.pi), 1)[..., None] * cells.DIRECTION_BINS
        apart = np.abs(np.arange(cells.DIRECTION_BINS) - around)
        directions = np.maximum(0, 1 - np.minimum(apart, cells.DIRECTION_BINS - apart))
        parts = (0.95 * seen, periods, directions, 0.05 * seen)
        answers.append(cells.CellAnswers(*(part.astype(np.float32) for part in parts)))
    return answers
