"""Read the ruling of millimetre paper: how many square millimetres a pixel covers, anywhere on the sheet.

The ruling is a lattice, so the spectrum of a patch has peaks at the multiples of two frequency vectors: the
gradients of the sheet's coordinates X and Y, in periods per pixel. Peaks are measured in many patches and one
homography is fitted to all of them, so tilt is measured and corrected. Which family of lines a peak belongs
to (1, 5 or 10 mm) is decided by a score of all harmonics. All of it is one TensorFlow graph; only the photo
is resized before it, and the result derived from its ten numbers.
"""

from functools import cache

import cv2
import numpy as np
import tensorflow as tf

from laesi_tf.common.arrays import Homography, Mask, RgbImage
from laesi_tf.estimators.camera_fit import Ruling, estimate_tilt_deg
from laesi_tf.estimators.photo_pyramid import OVERVIEW_SIDE_PX
from laesi_tf.estimators.ruling_reader import harmonics, patches, peaks
from laesi_tf.estimators.ruling_reader.lattice import lattice_frequencies, median, rate
from laesi_tf.estimators.ruling_reader.patches import BORDER, FRAME
from laesi_tf.estimators.ruling_reader.spectra import BINS, SIDE, compute_spectra

_VIEWS_MM = 40, 450
"""Longer side, mm, of the part of a sheet that a photo may show."""
_FEWEST, _DOUBTFUL, _WIDEST = 10, 0.6, 0.01
"""Refusal: fewer measured frequencies, less confidence, or a larger median residual than these."""
_FAINTEST, _FAINTEST_PLAIN = 0.0, 8.0
"""Refusal: less evidence of a ruling, log-odds, than these. For squared paper the weights are set by hand;
two sheets of it scored 10, and false positives on 110 crops with too few squares, mostly blocks of JPEG, at
most 7.1."""
_SMALLEST = 480
"""Longest side of the working image of squared paper, pixels: two patches and a half."""
_LARGEST = 2.0
"""How much a small photo may be enlarged to contain a patch."""
_FINEST_PX = 3.4
"""Pixels per period, at least, of the working image of the widest view: other rulings need fewer pixels."""
_PLAIN_MM = 2.0
"""Distance between the finest lines, mm, from which on paper is squared paper."""
_SEED_STRIDE, _SEEDS = 2, 3
_SAMPLES = 5.0
"""Samples per period of the rectified patches, where the photo has as many: a patch then shows four periods
of the heaviest lines."""


def read_ruling(
    image: RgbImage,
    *,
    leaf: Mask | None = None,
    grid_mm: float = 1.0,
    rough_px_per_mm: float | None = None,
) -> Ruling | None:
    """Read the ruling on `image`, uint8 [H, W, 3]; None where there is no readable one.

    `leaf`, bool [H, W], is left out. `grid_mm` is the distance between the finest lines. `rough_px_per_mm` is
    a rough scale from another source, which helps to decide which lines are the finest.
    """
    small = _resize_to_working_size(image, grid_mm)
    if small is None:
        return None
    height, width = small.shape[:2]
    plain = grid_mm >= _PLAIN_MM
    weights, faintest = (harmonics.PLAIN, _FAINTEST_PLAIN) if plain else (harmonics.MILLIMETRES, _FAINTEST)
    view = [
        0.0 if rough_px_per_mm is None else max(image.shape[:2]) / rough_px_per_mm / grid_mm,
        *(mm / grid_mm for mm in _VIEWS_MM),
    ]
    found = compile_graph()(
        _pad_to_frame(small, leaf), np.array([height, width], np.int32), np.array(view, np.float32), weights
    )
    lattice, (evidence, share, inliers, spread) = (part.numpy() for part in found)
    clear = inliers >= _FEWEST and evidence >= faintest and share >= _DOUBTFUL and spread <= _WIDEST
    if not (clear and np.isfinite(lattice).all()):
        return None
    shrunk = np.diag([width / image.shape[1], height / image.shape[0], 1.0])
    to_mm = np.diag([grid_mm, grid_mm, 1.0]) @ _homography(lattice, height, width) @ shrunk
    tilt = estimate_tilt_deg(to_mm, image.shape[:2])
    return Ruling(to_mm, tilt, float(share), int(inliers), float(spread))


def _resize_to_working_size(image: RgbImage, grid_mm: float) -> RgbImage | None:
    """Return `image` at the size that its ruling needs; None where it is too small."""
    longer, shorter = max(image.shape[:2]), min(image.shape[:2])
    longest = min(OVERVIEW_SIDE_PX, max(_SMALLEST, 2 * _FINEST_PX * _VIEWS_MM[1] / grid_mm))
    scale = max(min(1.0, longest / longer), SIDE / shorter)
    if scale > _LARGEST or scale * longer > OVERVIEW_SIDE_PX:
        return None
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return cv2.resize(image, None, fx=scale, fy=scale, interpolation=interpolation)


def _pad_to_frame(small: RgbImage, leaf: Mask | None) -> np.ndarray:
    """Return the working image [FRAME, FRAME] of a photo without its `leaf`.

    The darkest channel shows ink of any colour, on white as on tinted paper.
    """
    height, width = small.shape[:2]
    red, green, blue = (small[..., channel] for channel in range(3))
    grey = np.maximum(cv2.min(cv2.min(red, green), blue), 1)
    if leaf is not None:
        grey *= 1 - cv2.resize(leaf.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    framed = np.zeros((FRAME, FRAME), np.uint8)
    framed[BORDER : BORDER + height, BORDER : BORDER + width] = grey
    return framed


def _homography(lattice: np.ndarray, height: int, width: int) -> Homography:
    """Return the homography [3, 3] from pixels of the working image to periods of the lattice [6]."""
    half = max(height, width) / 2
    to_units = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, half]]) / half
    a, b, d, e, g, h = lattice.astype(float)
    return np.array([[a, b, 0], [d, e, 0], [g, h, 1]]) @ to_units


@cache
def compile_graph() -> tf.types.experimental.PolymorphicFunction:
    """Return `fit_lattice` with a fixed signature, of operations that TFLite has built in."""
    return tf.function(
        fit_lattice,
        input_signature=[
            tf.TensorSpec([FRAME, FRAME], tf.uint8, "picture"),
            tf.TensorSpec([2], tf.int32, "size"),
            tf.TensorSpec([3], tf.float32, "view"),
            tf.TensorSpec([9], tf.float32, "weights"),
        ],
        autograph=False,
    )


def fit_lattice(
    picture: tf.Tensor, size: tf.Tensor, view: tf.Tensor, weights: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """Fit a lattice [6] to the ruling in a working image `picture` of a photo of `size` (height, width).

    `view` and `weights` are as in `harmonics.select_family`. Also returns [4]: the evidence of a ruling
    (log-odds, 0 where nothing is plausible), the share of likelihood of this family, the number of
    frequencies that agree, and the median of their relative residual.
    """
    half = tf.cast(tf.reduce_max(size), tf.float32) / 2
    pixels, middles, steps = patches.choose_patches(picture, size)
    centres = (middles - tf.cast(tf.reverse(size, [0]), tf.float32) / 2) / half
    ink, bare = patches.extract_ink(pixels)
    seen = compute_spectra(ink, centres, bare, steps * BINS / half)
    seeds, places, score = harmonics.find_seeds(seen, _SEED_STRIDE)
    best = tf.math.top_k(score, _SEEDS).indices
    grown, good = peaks.grow_lattices(
        seen,
        tf.gather(seeds, best),
        tf.gather(places, best),
        ((0.45, 0.1), (0.9, 0.08), (3.0, 0.06), (3.0, 0.03)),
    )
    first = harmonics.select_family(seen, grown, good, view, weights)
    return _refit_rectified(picture, size, first.lattice, first.factors, centres, view, weights)


def _refit_rectified(
    picture: tf.Tensor,
    size: tf.Tensor,
    first: tf.Tensor,
    factors: tf.Tensor,
    centres: tf.Tensor,
    view: tf.Tensor,
    weights: tf.Tensor,
) -> tuple[tf.Tensor, tf.Tensor]:
    """Repeat the fit on patches rectified by a `first` lattice; arguments and results as of `fit_lattice`.

    In rectified patches no harmonic is smeared: now the family can be decided, and the fit refined.
    """
    half = tf.cast(tf.reduce_max(size), tf.float32) / 2
    pace = rate(first)
    a, b, d, e, g, h = tf.unstack(first)
    u, v = tf.unstack(centres, axis=1)
    w = (g * u + h * v + 1) * pace
    straight = tf.stack([(a * u + b * v) / w, (d * u + e * v) / w], axis=1)
    step = tf.clip_by_value(1 / _SAMPLES, pace / half, 3 * pace / half)
    pixels = patches.rectify_patches(picture, size, first, straight * pace, step)
    ink, bare = patches.extract_ink(pixels)
    seen = compute_spectra(ink, straight, bare, tf.repeat(step / pace * BINS, centres.shape[0]))
    upright = tf.stack([pace / factors[0], 0.0, 0.0, pace / factors[1], 0.0, 0.0])[None]
    family = harmonics.select_family(seen, upright, tf.constant([True]), view, weights)
    second, _ = peaks.grow_lattices(seen, family.lattice[None], tf.zeros([1, 2]), ((3.0, 0.05), (3.0, 0.03)))
    found = peaks.measure_peaks(seen, second, 0.04)
    used = found.weight > 0
    error = tf.norm(lattice_frequencies(second, straight) - found.at, axis=-1) / (
        tf.norm(found.at, axis=-1) + 1e-9
    )
    spread = median(error, used)[0]
    inliers = tf.reduce_sum(tf.cast(used & (error < 2 * _WIDEST), tf.int32))
    strength = tf.reduce_mean(harmonics.score_families(seen, second, weights)) * family.plausible
    return _compose(second[0], first, pace), tf.stack(
        [strength, family.share, tf.cast(inliers, tf.float32), spread]
    )


def _compose(second: tf.Tensor, first: tf.Tensor, pace: tf.Tensor) -> tf.Tensor:
    """Return the lattice [6] in the image, of one that was found in the image rectified by `first`."""
    a, b, d, e, g, h = tf.unstack(first)
    inner = tf.stack([a / pace, b / pace, 0.0, d / pace, e / pace, 0.0, g, h, 1.0])
    p, q, r, s, m, n = tf.unstack(second)
    outer = tf.stack([p, q, 0.0, r, s, 0.0, m, n, 1.0])
    whole = tf.reshape(tf.matmul(tf.reshape(outer, [3, 3]), tf.reshape(inner, [3, 3])), [9])
    return tf.gather(whole / whole[8], [0, 1, 3, 4, 6, 7])
