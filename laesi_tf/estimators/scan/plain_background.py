"""The plain background of a scan: its colour, which may change slowly over the image, and its noise."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.common.arrays import FloatMap, Mask, RgbImage
from laesi_tf.common.geometry import ImageSize
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, shrink

DRAWN_SCANS = "drawn scans on white, black, grey, blue and cloth, 2026-11-29"
"""Data and date on which these parameters were set."""
_BINS = 16
_FIT_ROUNDS = 4
_FIRST_TOLERANCE = 48.0
_SAMPLES = 200_000
_ROWS = 512


@dataclass(frozen=True, kw_only=True)
class PlainBackgroundParams:
    """Parameters of the background."""

    overview_px: int = parameter(512, unit="pixels", set_on=DRAWN_SCANS)
    """Longer side of the image that the colour is fitted to."""
    frame_share: float = parameter(0.03, unit="share of the sides", set_on=DRAWN_SCANS)
    """Width of the frame at the border, which shows mostly background."""
    min_frame_share: float = parameter(0.5, unit="share of the frame", set_on=DRAWN_SCANS)
    """A plain background covers at least so much of the frame."""
    min_difference: float = parameter(22.0, unit="levels of 255", set_on=DRAWN_SCANS)
    """Pixels differ at least so much from the background."""
    noise_factor: float = parameter(4.0, unit="standard deviations", set_on=DRAWN_SCANS)
    """The same in terms of the noise."""
    max_noise: float = parameter(10.0, unit="levels of 255", set_on=DRAWN_SCANS)
    """A background of larger standard deviation has a pattern."""
    max_paper_noise: float = parameter(
        4.5, unit="levels of 255", set_on="rendered (split develop) and cases, 2026-11-29"
    )
    """The same for one as light as paper, which may be ruled."""
    min_line: float = parameter(
        10.0, unit="levels of 255", set_on="rendered (split develop) and semireal's train, 2026-11-29"
    )
    """Lines of a ruling differ at least so much from their paper."""
    paper_level: float = parameter(140.0, unit="levels of 255", set_on="rendered (split develop), 2026-11-29")
    """Paper is at least so light."""
    max_marked: float = parameter(
        0.01, unit="share of the background", set_on="rendered (split develop) and cases, 2026-11-29"
    )
    """At most so much of a plain background differs from its colour like a leaf does."""


@dataclass(frozen=True, eq=False)
class PlainBackground:
    """A background of one colour."""

    surface: NDArray[np.float32]
    """float32 [h, w, 3], its colour over the whole image, at low resolution."""
    noise: float
    """Standard deviation of its pixels, levels of 255."""
    threshold: float
    """Largest difference in a channel that is background."""

    def compare(self, image: RgbImage) -> tuple[NDArray[np.uint8], Mask]:
        """Return how much each pixel of the whole `image`, uint8 [H, W, 3], differs from it: uint8 [H, W].

        It is the largest difference of a channel. The second result, bool [H, W], says where only the light
        differs, as in a shadow.
        """
        result, is_shadow = np.empty(image.shape[:2], np.uint8), np.empty(image.shape[:2], bool)
        for top in range(0, len(image), _ROWS):
            rows = image[top : top + _ROWS].astype(np.float32)
            background = self._surface_rows(top, len(rows), ImageSize.of(image))
            difference = np.abs(rows - background).max(axis=2)
            result[top : top + _ROWS] = np.minimum(np.round(difference), 255)
            is_shadow[top : top + _ROWS] = self._is_shadow(rows, background)
        return result, is_shadow

    def _is_shadow(self, rows: NDArray[np.float32], background: NDArray[np.float32]) -> Mask:
        """Return where pixels [h, w, 3] have the colour of the background, but less light."""
        share = (rows * background).sum(axis=2) / np.maximum((background**2).sum(axis=2), 1)
        rest = np.abs(rows - share[..., None] * background).max(axis=2)
        is_darker = (share > _DEEPEST_SHADOW) & (share < 1)
        return is_darker & (rest < _SHADOW_TOLERANCE + self.noise) & (background.mean(axis=2) > _LIGHT)

    def _surface_rows(self, top: int, count: int, size: ImageSize) -> NDArray[np.float32]:
        """Return rows `top` to `top + count` of the surface at the image's size: float32 [count, W, 3]."""
        return _interpolate_rows(self.surface, top, count, size)


_DEEPEST_SHADOW = 0.55
"""Share of the light that a shadow leaves, at least."""
_SHADOW_TOLERANCE = 8.0
"""Levels by which a shadow's colour differs from the background's."""
_LIGHT = 90.0
"""Mean level of a background on which shadows can be seen."""


def fit_background(image: RgbImage, params: PlainBackgroundParams | None = None) -> PlainBackground | None:
    """Fit the plain background of `image`, uint8 [H, W, 3]; None if it has no plain background."""
    params = params or PlainBackgroundParams()
    small = shrink(Crop(image, np.zeros(2), np.ones(2)), params.overview_px).image.astype(np.float32)
    frame = _make_frame(ImageSize.of(small), params.frame_share)
    colour = _find_frequent_colour(small, frame)
    surface, inliers = _fit_surface(small, colour)
    if inliers[frame].mean() < params.min_frame_share:
        return None
    noise, differences = _measure_noise(image, surface, inliers)
    is_paper = float(surface[inliers].mean()) > params.paper_level
    if noise > (params.max_paper_noise if is_paper else params.max_noise):
        return None
    threshold = max(params.min_difference, params.noise_factor * noise)
    # Faint lines are below the threshold of leaves, and far above the noise.
    line = max(params.min_line, params.noise_factor * noise) if is_paper else threshold
    if (differences > line).mean() > params.max_marked:
        return None
    return PlainBackground(surface, noise, threshold)


def _make_frame(size: ImageSize, share: float) -> Mask:
    frame = np.ones(size, bool)
    rows, columns = (max(2, round(share * side)) for side in size)
    frame[rows:-rows, columns:-columns] = False
    return frame


def _find_frequent_colour(image: NDArray[np.float32], frame: Mask) -> NDArray[np.float32]:
    """Return the most frequent colour [3]; the frame counts as much as all else."""
    in_frame = int(np.count_nonzero(frame))
    weights = np.where(frame, 1 / in_frame, 1 / max(1, frame.size - in_frame)).ravel()
    best, best_share = np.zeros(3, np.float32), -1.0
    pixels = image.reshape(-1, 3)
    # Two grids of bins, so that a colour at the border of one is inside the other.
    for shift in (0.0, 0.5):
        bins = np.minimum((pixels / 256 * _BINS + shift).astype(np.int64), _BINS)
        index = (bins * [(_BINS + 1) ** 2, _BINS + 1, 1]).sum(axis=1)
        shares = np.bincount(index, weights)
        top = int(shares.argmax())
        if shares[top] > best_share:
            best, best_share = np.median(pixels[index == top], axis=0), float(shares[top])
    return best


def _fit_surface(image: NDArray[np.float32], colour: NDArray[np.float32]) -> tuple[NDArray[np.float32], Mask]:
    """Fit a quadratic surface [h, w, 3] to the pixels of about `colour`; return it and their mask [h, w]."""
    height, width = image.shape[:2]
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    surface = np.broadcast_to(colour, image.shape)
    tolerance = _FIRST_TOLERANCE
    inliers = np.abs(image - surface).max(axis=2) <= tolerance
    for _ in range(_FIT_ROUNDS):
        if np.count_nonzero(inliers) < 10 * terms.shape[-1]:
            break
        factors = np.linalg.lstsq(terms[inliers], image[inliers], rcond=None)[0]
        surface = (terms @ factors).astype(np.float32)
        residual = np.abs(image - surface).max(axis=2)
        tolerance = max(12.0, 4 * float(np.median(residual[inliers])))
        inliers = residual <= min(tolerance, _FIRST_TOLERANCE)
    return np.ascontiguousarray(surface, np.float32), inliers


def _measure_noise(
    image: RgbImage, surface: NDArray[np.float32], inliers: Mask
) -> tuple[float, NDArray[np.float32]]:
    """Return the noise of the background at full resolution, and the differences of some pixels [n]."""
    inside = cv2.erode(inliers.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    inside = inside if inside.any() else inliers
    size, small = ImageSize.of(image), ImageSize.of(inliers)
    random = np.random.default_rng(0)
    rows = random.integers(0, size.height, _SAMPLES)
    columns = random.integers(0, size.width, _SAMPLES)
    low_rows, low_columns = rows * small.height // size.height, columns * small.width // size.width
    chosen = inside[low_rows, low_columns]
    pixels = image[rows[chosen], columns[chosen]].astype(np.float32)
    rest = pixels - surface[low_rows[chosen], low_columns[chosen]]
    # The 68th percentile of the absolute value is the standard deviation, and ignores dust.
    return float(np.percentile(np.abs(rest), 68.3)), np.abs(rest).max(axis=1)


def _interpolate_rows(surface: FloatMap, top: int, count: int, size: ImageSize) -> NDArray[np.float32]:
    """Return `count` rows from `top` on of `surface` [h, w, 3], resized to `size`."""
    height = len(surface)
    centres = (np.arange(top, top + count) + 0.5) * height / size.height - 0.5
    low = np.clip(np.floor(centres), 0, height - 1).astype(int)
    high = np.minimum(low + 1, height - 1)
    share = np.clip(centres - low, 0, 1)[:, None, None].astype(np.float32)
    wide = cv2.resize(
        surface[low[0] : high[-1] + 1], (size.width, high[-1] + 1 - low[0]), interpolation=cv2.INTER_LINEAR
    )
    wide = wide.reshape(high[-1] + 1 - low[0], size.width, -1)
    return wide[low - low[0]] * (1 - share) + wide[high - low[0]] * share
