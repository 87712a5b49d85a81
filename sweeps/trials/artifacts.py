"""Draw the artifacts of a trial for the dashboard: its loss curve and the images with the largest errors.

Drawn with OpenCV: a Matplotlib chart takes a tenth of a second, much for a trial of a few seconds.
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from sweeps.trials.training_data import Batch

_WIDTH, _HEIGHT, _MARGIN = 360, 220, 34
_IMAGES, _IMAGE_SIDE = 6, 128
_TEXT_COLOUR, _GRID_COLOUR, _LINE_COLOUR = (60, 40, 30), (225, 220, 215), (180, 100, 20)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_loss_curve(losses: Sequence[float]) -> bytes:
    """Return a PNG of the loss against the step, the loss on a logarithmic axis."""
    image = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)
    logs = np.log10(np.maximum(losses, 1e-6))
    low, high = np.floor(logs.min() * 10) / 10, np.ceil(logs.max() * 10) / 10 + 1e-6
    left, right, bottom = _MARGIN + 8, _WIDTH - 10, _HEIGHT - _MARGIN
    x = np.linspace(left, right, len(losses))
    y = bottom - (logs - low) / (high - low) * (bottom - 10)
    for fraction in np.linspace(0, 1, 5):
        height = round(bottom - fraction * (bottom - 10))
        cv2.line(image, (left, height), (right, height), _GRID_COLOUR, 1)
        _put_text(image, f"{10 ** (low + fraction * (high - low)):.2g}", (2, height + 4))
    points = np.stack([x, y], axis=1).round().astype(np.int32)
    cv2.polylines(image, [points], False, _LINE_COLOUR, 2, cv2.LINE_AA)
    _put_text(image, f"loss over {len(losses)} steps", (left, _HEIGHT - 10))
    return _encode(".png", image)


def draw_worst_images(results: Mapping[str, np.ndarray], validation: Sequence[Batch]) -> bytes:
    """Return a JPEG of the validation images with the largest errors, with predicted and true area.

    `results` has arrays [N] "error", "predicted" and "true" over the images of `validation`.
    """
    batch_size = len(validation[0][0])
    tiles = []
    for index in np.argsort(results["error"])[::-1][:_IMAGES]:
        image = validation[index // batch_size][0][index % batch_size].numpy()
        enlarged = cv2.resize(image[..., ::-1], (_IMAGE_SIDE, _IMAGE_SIDE), interpolation=cv2.INTER_NEAREST)
        caption = np.full((18, _IMAGE_SIDE, 3), 255, np.uint8)
        text = f"{results['predicted'][index]:.1f} for {results['true'][index]:.1f} cm2"
        _put_text(caption, text, (3, 13))
        tiles.append(np.concatenate([enlarged, caption]))
    half = len(tiles) // 2
    rows = [np.concatenate(tiles[first : first + half], axis=1) for first in (0, half)]
    return _encode(".jpg", np.concatenate(rows))


def _put_text(image: np.ndarray, text: str, position: tuple[int, int]) -> None:
    cv2.putText(image, text, position, _FONT, 0.36, _TEXT_COLOUR, 1, cv2.LINE_AA)


def _encode(suffix: str, image: np.ndarray) -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()
