"""Read the ruling of millimetre paper: how many square millimetres a pixel covers, anywhere on the sheet.

The ruling is a lattice, so the spectrum of a patch has peaks at the multiples of two frequency vectors: the
gradients of the sheet's coordinates X and Y, in periods per pixel. Peaks are measured in many patches and one
homography is fitted to all of them, so tilt is measured and undone. Which family of lines a peak belongs to
(1, 5 or 10 mm) is decided by the comb that all harmonics make together.
"""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

LONGEST = 1536
"""Photos are shrunk to this many pixels first: 1 mm is then at least 5 pixels in views up to 30 cm."""
_PATCH = 192
_SMALLEST = 96
"""Pictures with a shorter side of fewer pixels hold too few lines."""
_GRID = 6
_ANGLES = np.deg2rad(np.arange(0, 180, 1.0))
_STEP = 0.01
_FREQUENCIES = np.exp(np.arange(math.log(1 / 80), math.log(0.46), _STEP))
_HARMONICS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 2.0, 5.0)
_TEETH = (0.1, 0.2, 0.5, *(10 / tooth for tooth in range(1, 11)))
"""How much finer than the lines that were followed the finest may be: these were any tooth of the comb."""
_SEEDS, _SEED_STRIDE = 5, 3
_VIEWS_MM = 40, 450
"""Longer side of the sheet that a picture may show."""
_FEWEST, _FAINTEST, _WIDEST = 10, 2.0, 0.01
"""Refusal: fewer measured frequencies, a fainter comb, or a larger median disagreement than these."""
_SQUARE = 1.15
"""Ratio of scales along and across a sheet that tilt may cause in the middle of the picture."""
_STEEPEST = 0.4
"""Change of scale from the middle to the border that a fit may claim: twice that of a tilt of 20 degrees."""
_TRUST = 15.0
"""Score that a lattice loses per squared logarithm of its distance from a rough scale.

At a factor of 1.6 that is what a weak comb is behind a strong one: the comb overrules a rough scale that is
wrong, and yields to a good one where its family is in doubt.
"""


@dataclass(frozen=True, eq=False)
class Ruling:
    """A homography from photo pixels to sheet millimetres, up to translation, and how well it is founded.

    `forward` [3, 3] maps (x, y, 1) in pixels, pixel centres at whole numbers plus one half.
    """

    forward: np.ndarray
    evidence: float
    """The comb's score, a sum of log-prominences."""
    inliers: int
    spread: float
    """Median relative disagreement between the measured and the fitted frequency vectors."""

    def mm2_per_px(self, points: np.ndarray) -> np.ndarray:
        """Sheet area under a pixel, mm2, at `points` [N, 2] in pixels: the Jacobian's determinant."""
        w = points @ self.forward[2, :2] + self.forward[2, 2]
        return abs(np.linalg.det(self.forward)) / np.abs(w) ** 3

    def px_per_mm(self, point: np.ndarray) -> float:
        """Scale at `point` [2]."""
        return float(1 / np.sqrt(self.mm2_per_px(point[None])[0]))


def read_ruling(
    image: np.ndarray, *, leaf: np.ndarray | None = None, grid_mm: float = 1.0, about: float | None = None
) -> Ruling | None:
    """Read the ruling on `image`, uint8 [H, W, 3]; None where there is none to read.

    `leaf`, bool [H, W], is left out. `grid_mm` is the distance of the finest lines. `about`, px per mm, is a
    rough scale from elsewhere that helps to tell which lines are the finest.
    """
    shrink = min(1.0, LONGEST / max(image.shape[:2]))
    small = cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    if min(small.shape[:2]) < _SMALLEST:
        return None
    covered = np.zeros(small.shape[:2], np.uint8)
    if leaf is not None:
        covered = cv2.resize(leaf.astype(np.uint8), small.shape[1::-1])
    view = _View(
        rough=None if about is None else max(image.shape[:2]) / about / grid_mm,
        low=_VIEWS_MM[0] / grid_mm,
        high=_VIEWS_MM[1] / grid_mm,
    )
    flat = _flattened(small)
    field = _Field.of(flat, covered)
    grown = [lattice for seed in field.seeds() if (lattice := _grow(field, seed)) is not None]
    first = _best_family(field, grown, view)
    if first is None:
        return None
    # Seen straight on, no tooth of the comb is smeared: now the family can be told, and the fit refined.
    straighten = _straightening(field, first)
    field = _Field.of(_warped(flat, straighten, 0), _warped(covered, straighten, 1))
    rate = _periods(first) / 2
    best = _best_family(field, [np.array([rate, 0, 0, rate, 0, 0])], view)
    if best is not None:
        best = _regrown(field, best, ((3.0, 0.05), (3.0, 0.03)), field.centres.mean(axis=0))
    if best is None:
        return None
    return _finish(field, best, straighten @ np.diag([shrink, shrink, 1.0]), grid_mm)


def _straightening(field: "_Field", lattice: np.ndarray) -> np.ndarray:
    """Homography [3, 3] of pixels that turns the sheet upright and undoes its tilt, at the same scale."""
    rate = _periods(lattice) / 2 / field.half
    back = np.array([[1 / rate, 0, field.origin[0]], [0, 1 / rate, field.origin[1]], [0, 0, 1]])
    return back @ field.homography(lattice)


def _warped(picture: np.ndarray, homography: np.ndarray, beyond: int) -> np.ndarray:
    """`picture` [H, W] through a homography of pixels, their centres at halves; `beyond` outside it."""
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix = np.linalg.inv(shift) @ homography @ shift
    return cv2.warpPerspective(picture, matrix, picture.shape[::-1], borderValue=beyond)


class _View(NamedTuple):
    """What is known of the picture's longer side beforehand, in periods of the finest lines."""

    rough: float | None
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class _Field:
    """The spectra of patches: `power` [K, N, N] with frequency 0 at N / 2, and its `prominence`.

    `centres` [K, 2] are in units of `half` pixels from the picture's middle `origin`.
    """

    power: np.ndarray
    prominence: np.ndarray
    centres: np.ndarray
    origin: np.ndarray
    half: float

    @staticmethod
    def of(flat: np.ndarray, covered: np.ndarray) -> "_Field":
        """The spectra of a flattened picture [H, W] where it is not `covered` [H, W]."""
        side = min(_PATCH, *(length // 2 for length in flat.shape))
        corners = [
            (y, x)
            for y in np.linspace(0, flat.shape[0] - side, _GRID).astype(int)
            for x in np.linspace(0, flat.shape[1] - side, _GRID).astype(int)
            if covered[y : y + side, x : x + side].mean() < 0.4
        ]
        window = np.hanning(side)[:, None] * np.hanning(side)
        patches = np.stack([flat[y : y + side, x : x + side] for y, x in corners] or [np.zeros((side, side))])
        patches = (patches - patches.mean(axis=(1, 2), keepdims=True)) * window
        spectra = np.fft.fft2(patches.astype(np.float32))
        power = np.fft.fftshift(np.abs(spectra) ** 2, axes=(1, 2)).astype(np.float32) + 1e-3
        origin = np.array(flat.shape[::-1]) / 2
        half = max(flat.shape) / 2
        middles = np.array(corners or [(0, 0)])[:, ::-1] + side / 2
        return _Field(
            power, np.stack([_standing_out(one) for one in power]), (middles - origin) / half, origin, half
        )

    def seeds(self) -> list[np.ndarray]:
        """Lattices [6] without tilt, one from each of the patches whose combs stand out most."""
        found = []
        for index in range(0, len(self.power), _SEED_STRIDE):
            score = _patch_score(_polar(self.prominence[index]))
            angle, rate = np.unravel_index(score.argmax(), score.shape)
            along = (
                self.half * _FREQUENCIES[rate] * np.array([np.cos(_ANGLES[angle]), np.sin(_ANGLES[angle])])
            )
            found.append((score.max(), index, along))
        found.sort(key=lambda seed: -seed[0])
        return [np.array([a, b, -b, a, 0.0, 0.0, index]) for _, index, (a, b) in found[:_SEEDS]]

    def homography(self, lattice: np.ndarray) -> np.ndarray:
        """From pixels, their centres at halves, to periods of the lattice: [3, 3]."""
        x, y = self.origin
        to_units = np.array([[1, 0, -x], [0, 1, -y], [0, 0, self.half]]) / self.half
        a, b, d, e, g, h = lattice
        return np.array([[a, b, 0], [d, e, 0], [g, h, 1]]) @ to_units

    def gradients(self, lattice: np.ndarray, which: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Gradients of X and Y [n, 2 families, 2] at the patches, periods per `half` pixels."""
        a, b, d, e, g, h = lattice
        u, v = self.centres[which].T
        w = g * u + h * v + 1
        x, y = (a * u + b * v) / w, (d * u + e * v) / w
        along = np.stack([a - x * g, b - x * h], axis=-1) / w[:, None]
        across = np.stack([d - y * g, e - y * h], axis=-1) / w[:, None]
        return np.stack([along, across], axis=1)


def _flattened(image: np.ndarray) -> np.ndarray:
    """The ink's contrast, float32 [H, W] within -3..3, free of shading.

    The darkest channel shows ink of any colour, on white as on tinted paper.
    """
    grey = image.min(axis=2).astype(np.float32)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), 9)
    spread = np.sqrt(cv2.blur(detail * detail, (55, 55))) + 2
    return np.clip(detail / spread, -3, 3)


def _standing_out(power: np.ndarray) -> np.ndarray:
    """Log-power [N, N] of each frequency or its best neighbour over those around it, at least 0."""
    logs = np.log(power)
    return np.maximum(cv2.dilate(logs, np.ones((3, 3))) - cv2.blur(logs, (9, 9)) - 1, 0)


def _polar(prominence: np.ndarray) -> np.ndarray:
    """`prominence` [N, N] in polar coordinates: [angles, frequencies]."""
    side = prominence.shape[0]
    x = np.outer(np.cos(_ANGLES), _FREQUENCIES) * side + side // 2
    y = np.outer(np.sin(_ANGLES), _FREQUENCIES) * side + side // 2
    return cv2.remap(prominence, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


def _patch_score(polar: np.ndarray) -> np.ndarray:
    """Score [angles / 2, frequencies] of each untilted square lattice for one patch."""
    half = len(_ANGLES) // 2
    both = polar[:half] + polar[half:]
    return _combined({factor: _stretched(both, factor) for factor in _HARMONICS})


def _stretched(polar: np.ndarray, factor: float) -> np.ndarray:
    """`polar` read at `factor` times each frequency, zero outside the range."""
    index = np.arange(polar.shape[1]) + round(math.log(factor) / _STEP)
    inside = (index >= 0) & (index < polar.shape[1])
    return np.where(inside, polar[:, np.clip(index, 0, polar.shape[1] - 1)], 0)


def _combined(prominence: dict[float, np.ndarray]) -> np.ndarray:
    """Weigh the comb: fine lines, and behind every fifth or every tenth a heavier one.

    Lines at odd tenths speak against every fifth being heavier, and for every tenth.
    """
    fine = prominence[1.0]
    even = (prominence[0.2] + prominence[0.4] + prominence[0.6] + prominence[0.8]) / 4
    odd = (prominence[0.1] + prominence[0.3] + prominence[0.5] + prominence[0.7] + prominence[0.9]) / 5
    return fine + 1.5 * np.maximum(even - 0.5 * odd, (4 * even + 5 * odd) / 9) + 0.25 * prominence[2.0]


def _grow(field: _Field, seed: np.ndarray) -> np.ndarray | None:
    """Fit a lattice [6] to the peaks around a seed, taking in patches further and further away."""
    stages = ((0.45, 0.12), (0.9, 0.1), (3.0, 0.08), (3.0, 0.05), (3.0, 0.04))
    return _regrown(field, seed[:6], stages, field.centres[int(seed[6])])


def _regrown(
    field: _Field, lattice: np.ndarray, stages: tuple[tuple[float, float], ...], start: np.ndarray
) -> np.ndarray | None:
    """Fit a lattice [6] by stages of (reach from `start`, tolerance of peaks); None without peaks."""
    distance = np.hypot(*(field.centres - start).T)
    for reach, tolerance in stages:
        near = np.flatnonzero(distance <= reach)
        measured, weights = _peaks(field, lattice, near, tolerance)
        if np.count_nonzero(weights) < 4:
            return None
        tilted = int(np.count_nonzero(weights.sum(axis=1))) >= 5
        lattice = _fitted(field, lattice, near, measured, weights, tilted=tilted)
    return lattice


def _best_family(field: _Field, lattices: list[np.ndarray], view: _View) -> np.ndarray | None:
    """The lattice [6] whose lines make the best comb, each taken for any of its teeth."""
    families = [family for lattice in lattices for family in _families(field, lattice, view)]
    return max(families, key=lambda family: family[0])[1] if families else None


def _families(field: _Field, lattice: np.ndarray, view: _View) -> list[tuple[float, np.ndarray]]:
    """Score and lattice of each way to take the lines that were followed for teeth of the comb.

    The two directions are judged apart, as each may have followed another tooth, but must agree in the end.
    """
    scores = {factor: _comb_scores(field, _rescaled(lattice, factor, factor)) for factor in _TEETH}
    found = []
    for across, down in itertools.product(_TEETH, repeat=2):
        family = _rescaled(lattice, across, down)
        if _plausible(family, view):
            doubt = 0.0 if view.rough is None else _TRUST * math.log(_periods(family) / view.rough) ** 2
            found.append((float(scores[across][0] + scores[down][1]) / 2 - doubt, family))
    return found


def _peaks(
    field: _Field, lattice: np.ndarray, which: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Peaks [n, 2, 2] near the lattice's frequencies in patches `which`, and weights [n, 2], 0 for none."""
    expected = field.gradients(lattice, which) / field.half
    measured, weights = np.zeros_like(expected), np.zeros(expected.shape[:2])
    for row, index in enumerate(which):
        for family in (0, 1):
            found = _peak(field.power[index], expected[row, family], tolerance)
            if found is not None:
                measured[row, family], weights[row, family] = found
    return measured * field.half, weights


def _peak(power: np.ndarray, expected: np.ndarray, tolerance: float) -> tuple[np.ndarray, float] | None:
    """The highest point of a spectrum within `tolerance` of a frequency: its place and its prominence."""
    side = power.shape[0]
    place = expected * side + side // 2
    reach = max(2.0, tolerance * float(np.hypot(*expected)) * side)
    low, high = np.floor(place - reach).astype(int), np.ceil(place + reach).astype(int) + 1
    if low.min() < 1 or high.max() >= side - 1:
        return None
    part = np.log(power[low[1] - 1 : high[1] + 1, low[0] - 1 : high[0] + 1])
    inner = part[1:-1, 1:-1]
    rows, columns = np.ogrid[low[1] : high[1], low[0] : high[0]]
    disc = (columns - place[0]) ** 2 + (rows - place[1]) ** 2 <= reach**2
    row, column = np.unravel_index(np.where(disc, inner, -np.inf).argmax(), inner.shape)
    prominence = float(inner[row, column] - np.median(inner))
    if prominence < 2:
        return None
    shift = [
        _vertex(part[row + 1, column : column + 3]),
        _vertex(part[row : row + 3, column + 1]),
    ]
    peak = np.array([low[0] + column, low[1] + row]) + shift
    return (peak - side // 2) / side, min(prominence, 6.0)


def _vertex(samples: np.ndarray) -> float:
    """Offset of the vertex of the parabola through three samples from the middle one."""
    curvature = samples[0] - 2 * samples[1] + samples[2]
    return 0.0 if curvature >= 0 else float(np.clip((samples[0] - samples[2]) / (2 * curvature), -0.6, 0.6))


def _fitted(
    field: _Field,
    lattice: np.ndarray,
    which: np.ndarray,
    measured: np.ndarray,
    weights: np.ndarray,
    *,
    tilted: bool,
) -> np.ndarray:
    """Gauss-Newton with robust (Cauchy) weights on the relative error of the frequency vectors."""
    free = 6 if tilted else 4
    size = np.linalg.norm(measured, axis=-1, keepdims=True) + 1e-9
    scale = np.where(weights[..., None] > 0, np.sqrt(weights[..., None]) / size, 0)
    for _ in range(12):
        predicted = field.gradients(lattice, which)
        residual = (predicted - measured) * scale
        error = np.linalg.norm(residual, axis=-1, keepdims=True)
        positive = error[weights[..., None] > 0]
        robust = 1 / np.sqrt(1 + (error / max(1.5 * float(np.median(positive)), 1e-3)) ** 2)
        jacobian = np.stack(
            [
                (field.gradients(lattice + step, which) - predicted) * scale * robust / 1e-4
                for step in 1e-4 * np.eye(6)[:free]
            ],
            axis=-1,
        ).reshape(-1, free)
        change = np.linalg.lstsq(jacobian, -(residual * robust).ravel(), rcond=None)[0]
        lattice = lattice + np.pad(change, (0, 6 - free))
        if np.abs(change).max() < 1e-6:
            break
    return lattice


def _rescaled(lattice: np.ndarray, across: float, down: float) -> np.ndarray:
    """The same map with its lines taken for families `across` and `down` times as fine."""
    return np.concatenate([lattice[:2] * across, lattice[2:4] * down, lattice[4:6]])


def _plausible(lattice: np.ndarray, view: _View) -> bool:
    """Whether a lattice is square, not steeper than a phone is held, and as wide as phones see a sheet."""
    rates = np.hypot(*lattice[:4].reshape(2, 2).T)
    square = rates.max() <= _SQUARE * rates.min()
    return bool(square and np.hypot(*lattice[4:]) <= _STEEPEST and view.low <= _periods(lattice) <= view.high)


def _periods(lattice: np.ndarray) -> float:
    """The picture's longer side in periods of the lattice, at its middle."""
    return 2 * math.sqrt(abs(np.linalg.det(lattice[:4].reshape(2, 2))))


def _comb_scores(field: _Field, lattice: np.ndarray) -> np.ndarray:
    """The comb's score [2] in both directions, less what says that other lines are the finest.

    The finest lines are louder than their own second or fifth harmonic, and no tooth at one half rises over
    its neighbours: there only every tenth line could be heard.
    """
    loud = _harmonics(field, lattice, np.log(field.power), absent=-np.inf)
    with np.errstate(invalid="ignore"):
        neighbours = np.maximum(loud[0.4], loud[0.6])
        signs = np.stack([loud[2.0] - loud[1.0], loud[5.0] - loud[1.0], loud[0.5] - neighbours])
    against = np.clip(np.nan_to_num(signs, nan=0.0, posinf=0.0, neginf=0.0), 0, None).sum(axis=0)
    return _combined(_harmonics(field, lattice, field.prominence)) - 2 * against


def _harmonics(
    field: _Field, lattice: np.ndarray, values_at: np.ndarray, *, absent: float = 0.0
) -> dict[float, np.ndarray]:
    """Mean [2] of `values_at` [K, N, N] at the lattice's harmonics over the patches, in both directions.

    A harmonic beyond what the pixels resolve is `absent`.
    """
    side = field.power.shape[1]
    base = field.gradients(lattice) / field.half * side
    patch = np.arange(len(base))[:, None]
    found = {}
    for factor in _HARMONICS:
        places = base * factor
        inside = (np.abs(places).max(axis=-1) < side / 2 - 3) & (np.linalg.norm(places, axis=-1) > 2.5)
        column, row = (
            np.moveaxis(np.where(inside[..., None], np.round(places), 0).astype(int), -1, 0) + side // 2
        )
        values = np.where(inside, values_at[patch, row, column], 0)
        number = inside.sum(axis=0)
        found[factor] = np.where(number > 2, values.sum(axis=0) / np.maximum(number, 1), absent)
    return found


def _finish(field: _Field, lattice: np.ndarray, before: np.ndarray, grid_mm: float) -> Ruling | None:
    """The lattice as a ruling of the photo, whose pixels `before` [3, 3] takes to the field's.

    None where its lines are not there after all.
    """
    measured, weights = _peaks(field, lattice, np.arange(len(field.centres)), 0.04)
    used = weights > 0
    if np.count_nonzero(used) < _FEWEST:
        return None
    size = np.linalg.norm(measured, axis=-1)[used]
    errors = np.linalg.norm(field.gradients(lattice) - measured, axis=-1)[used] / size
    evidence, spread = float(_comb_scores(field, lattice).mean()), float(np.median(errors))
    if evidence < _FAINTEST or spread > _WIDEST:
        return None
    forward = np.diag([grid_mm, grid_mm, 1.0]) @ field.homography(lattice) @ before
    return Ruling(forward, evidence, int(np.count_nonzero(errors < 2 * _WIDEST)), spread)
