"""Nuisances that can be applied to any picture, scene or photograph.

Each takes a picture, a severity and a random generator and returns the picture with what is true about it
then. Light is scaled and blurred in linear intensities, since that is where it adds up.
"""

import dataclasses
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.common.arrays import RgbImage

Rng = np.random.Generator
_GAMMA = 2.2
_FOCAL = 1.2
"""Focal length in longer sides: a phone's main camera."""
_FINGER = np.array([222, 170, 140], np.float32)
_DESK = np.array([126, 92, 64], np.float32)


def blur_focus(photo: StressPhoto, sd_px: float, rng: Rng) -> StressPhoto:
    """Blur by a Gaussian of `sd_px` pixels."""
    return _with_light(photo, cv2.GaussianBlur(_to_light(photo.image), (0, 0), sd_px))


def blur_motion(photo: StressPhoto, length_px: float, rng: Rng) -> StressPhoto:
    """Blur along a line of `length_px` pixels in a random direction."""
    side = 2 * math.ceil(length_px / 2) + 3
    kernel = np.zeros((side, side), np.float32)
    along = rng.uniform(0, math.pi)
    for t in np.linspace(-length_px / 2, length_px / 2, 8 * side):
        x, y = side / 2 - 0.5 + t * math.cos(along), side / 2 - 0.5 + t * math.sin(along)
        kernel[round(y), round(x)] += 1
    return _with_light(photo, cv2.filter2D(_to_light(photo.image), -1, kernel / kernel.sum()))


def add_noise(photo: StressPhoto, sd: float, rng: Rng) -> StressPhoto:
    """Add normal noise of `sd` levels of 255."""
    noisy = photo.image + rng.normal(0, sd, photo.image.shape)
    return dataclasses.replace(photo, image=_to_bytes(noisy))


def compress_jpeg(photo: StressPhoto, quality: float, rng: Rng) -> StressPhoto:
    """Compress as a JPEG of `quality`."""
    _, encoded = cv2.imencode(
        ".jpg", np.ascontiguousarray(photo.image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, int(quality)]
    )
    decoded: Any = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    return dataclasses.replace(photo, image=np.ascontiguousarray(decoded[..., ::-1]))


def expose(photo: StressPhoto, gain: float, rng: Rng) -> StressPhoto:
    """Scale the light by `gain`; what is too bright is white, what is too dark is coarse in steps."""
    return _with_light(photo, _to_light(photo.image) * gain)


def shrink_photo(photo: StressPhoto, factor: float, rng: Rng) -> StressPhoto:
    """Shrink to `factor` of the sides by area means."""
    size = tuple(max(1, round(side * factor)) for side in photo.image.shape[1::-1])
    image = cv2.resize(photo.image, size, interpolation=cv2.INTER_AREA)
    mask = cv2.resize(photo.mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    return dataclasses.replace(photo, image=image, mask=mask, px_per_mm=photo.px_per_mm * factor)


def fade_ruling(photo: StressPhoto, share: float, rng: Rng) -> StressPhoto:
    """Take `share` of the contrast of all fine lines beside the leaf."""
    radius = max(3, round(2.5 * photo.px_per_mm)) | 1
    # Colours of the leaf do not bleed into the paper beside it.
    beside = cv2.blur((~photo.mask).astype(np.float32), (radius, radius))
    paper = photo.image * (~photo.mask)[..., None].astype(np.float32)
    mean = cv2.blur(paper, (radius, radius)) / np.maximum(beside, 1e-3)[..., None]
    faded = (1 - share) * photo.image + share * mean
    return dataclasses.replace(photo, image=_to_bytes(np.where(photo.mask[..., None], photo.image, faded)))


def bleach_leaf(photo: StressPhoto, share: float, rng: Rng) -> StressPhoto:
    """Blend the leaf's colour with that of the paper around it by `share`."""
    near = cv2.dilate(photo.mask.astype(np.uint8), np.ones((25, 25))) > 0
    paper = np.median(photo.image[near & ~photo.mask], axis=0)
    weight = share * cv2.GaussianBlur(photo.mask.astype(np.float32), (0, 0), 0.7)[..., None]
    return dataclasses.replace(photo, image=_to_bytes((1 - weight) * photo.image + weight * paper))


def cover_leaf(photo: StressPhoto, share: float, rng: Rng) -> StressPhoto:
    """Cover `share` of the leaf by a finger from one side; what is true is the area that is seen."""
    rows, columns = np.nonzero(photo.mask)
    along = rng.uniform(-math.pi, math.pi)
    depth = columns * math.cos(along) + rows * math.sin(along)
    y, x = np.mgrid[: photo.mask.shape[0], : photo.mask.shape[1]]
    across = (x - columns.mean()) * -math.sin(along) + (y - rows.mean()) * math.cos(along)
    level = np.quantile(depth, 1 - share)
    # Twelve millimetres wide where it may be, wider where it must be.
    beyond = x * math.cos(along) + y * math.sin(along) >= level
    finger = beyond & (np.abs(across) <= np.abs(across[photo.mask]).max() + 6 * photo.px_per_mm)
    soft = cv2.GaussianBlur(finger.astype(np.float32), (0, 0), 1.0)[..., None]
    texture = _FINGER + cv2.GaussianBlur(rng.normal(0, 40, photo.image.shape), (0, 0), 3)
    seen = photo.mask & ~finger
    return dataclasses.replace(
        photo,
        image=_to_bytes((1 - soft) * photo.image + soft * texture),
        mask=seen,
        area_cm2=photo.area_cm2 * float(seen.sum() / photo.mask.sum()),
    )


def cut_sheet(photo: StressPhoto, margin_mm: float, rng: Rng) -> StressPhoto:
    """Show a desk beyond `margin_mm` from the leaf's box."""
    rows, columns = np.nonzero(photo.mask)
    margin = margin_mm * photo.px_per_mm
    y, x = np.mgrid[: photo.mask.shape[0], : photo.mask.shape[1]]
    inside = (x >= columns.min() - margin) & (x <= columns.max() + margin)
    inside &= (y >= rows.min() - margin) & (y <= rows.max() + margin)
    grain = cv2.GaussianBlur(rng.normal(0, 60, photo.image.shape[:2]), (0, 0), 8, sigmaY=1)
    desk = _DESK + grain[..., None]
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 0.8)[..., None]
    return dataclasses.replace(photo, image=_to_bytes(weight * photo.image + (1 - weight) * desk))


def tilt_photo(photo: StressPhoto, angle_deg: float, rng: Rng) -> StressPhoto:
    """Turn the camera around the photo's middle by `angle_deg`, in a random direction."""
    height, width = photo.image.shape[:2]
    focal, angle, along = _FOCAL * max(height, width), math.radians(angle_deg), rng.uniform(0, 2 * math.pi)
    axis = np.array([math.cos(along), math.sin(along), 0.0]) * angle
    turn, _ = cv2.Rodrigues(axis)
    # The picture is a plane at the focal distance, which turns around its middle.
    plane = np.column_stack([turn[:, 0], turn[:, 1], np.array([0.0, 0.0, focal])])
    camera = np.diag([focal, focal, 1.0])
    to_middle = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1.0]])
    to_source = np.linalg.inv(np.linalg.inv(to_middle) @ camera @ plane @ to_middle)
    x, y = _pixel_centres(height, width)
    source = np.stack([x, y, np.ones_like(x)], -1) @ to_source.T
    return _warp(photo, source[..., :2] / source[..., 2:])


def distort_photo(photo: StressPhoto, k1: float, rng: Rng) -> StressPhoto:
    """Distort radially by `k1` per squared half of the longer side."""
    height, width = photo.image.shape[:2]
    unit, middle = max(height, width) / 2, np.array([width / 2, height / 2])
    place = (np.stack(_pixel_centres(height, width), -1) - middle) / unit
    factor = 1 + k1 * (place**2).sum(axis=-1, keepdims=True)
    return _warp(photo, place * factor * unit + middle)


def _warp(photo: StressPhoto, source: NDArray[np.floating]) -> StressPhoto:
    """Return the picture that shows at each pixel centre what the photo has at `source` [H, W, 2]."""
    x, y = (np.ascontiguousarray(axis, np.float32) for axis in np.moveaxis(source - 0.5, -1, 0))
    image: Any = cv2.remap(photo.image, x, y, cv2.INTER_CUBIC, None, cv2.BORDER_CONSTANT, _DESK.tolist())
    soft: Any = cv2.remap(photo.mask.astype(np.float32), x, y, cv2.INTER_LINEAR)
    mask = soft >= 0.5
    # Pixels of the photo under one of the new picture.
    down, right = np.gradient(source, axis=(0, 1))
    ratio = np.abs(down[..., 0] * right[..., 1] - down[..., 1] * right[..., 0])
    rows, columns = np.nonzero(mask)
    if not rows.size:
        return dataclasses.replace(photo, image=image, mask=mask, area_cm2=0.0)
    middle = round(rows.mean()), round(columns.mean())
    return dataclasses.replace(
        photo,
        image=image,
        mask=mask,
        area_cm2=photo.area_cm2 * float((soft * ratio).sum() / photo.mask.sum()),
        px_per_mm=photo.px_per_mm / math.sqrt(ratio[middle]),
    )


def _pixel_centres(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y, [H, W] each."""
    y, x = np.mgrid[:height, :width] + 0.5
    return x, y


def _to_light(image: RgbImage) -> NDArray[np.float32]:
    return np.power(image / np.float32(255), _GAMMA, dtype=np.float32)


def _with_light(photo: StressPhoto, light: NDArray[np.float32]) -> StressPhoto:
    return dataclasses.replace(photo, image=_to_bytes(255 * np.clip(light, 0, 1) ** (1 / _GAMMA)))


def _to_bytes(levels: NDArray[np.floating]) -> RgbImage:
    return np.clip(np.round(levels), 0, 255).astype(np.uint8)
