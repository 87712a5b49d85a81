"""Draw the artifacts of a trial for the dashboard: its loss curve and the images with the largest errors.

Drawn with OpenCV: a Matplotlib chart takes a tenth of a second, much for a trial of a few seconds.
"""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from sweeps.trials.training_data import Batch

_WIDTH, _HEIGHT, _MARGIN = 360, 220, 34
_SHOWN, _SIDE = 6, 128
_INK, _FAINT, _LINE = (60, 40, 30), (225, 220, 215), (180, 100, 20)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_loss_curve(losses: Sequence[float]) -> bytes:
    """A PNG of the loss against the step, the loss on a logarithmic axis."""
    image = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)
    logs = np.log10(np.maximum(losses, 1e-6))
    low, high = np.floor(logs.min() * 10) / 10, np.ceil(logs.max() * 10) / 10 + 1e-6
    right, bottom = _WIDTH - 10, _HEIGHT - _MARGIN
    across = np.linspace(_MARGIN + 8, right, len(losses))
    down = bottom - (logs - low) / (high - low) * (bottom - 10)
    for part in np.linspace(0, 1, 5):
        height = round(bottom - part * (bottom - 10))
        cv2.line(image, (_MARGIN + 8, height), (right, height), _FAINT, 1)
        _put_text(image, f"{10 ** (low + part * (high - low)):.2g}", (2, height + 4))
    points = np.stack([across, down], axis=1).round().astype(np.int32)
    cv2.polylines(image, [points], False, _LINE, 2, cv2.LINE_AA)
    _put_text(image, f"loss over {len(losses)} steps", (_MARGIN + 8, _HEIGHT - 10))
    return _encode(".png", image)


def draw_worst_images(found: Mapping[str, np.ndarray], validation: Sequence[Batch]) -> bytes:
    """A JPEG of the validation pictures with the largest errors, with predicted and true area."""
    batch = len(validation[0][0])
    shown = []
    for index in np.argsort(found["error"])[::-1][:_SHOWN]:
        picture = validation[index // batch][0][index % batch].numpy()
        large = cv2.resize(picture[..., ::-1], (_SIDE, _SIDE), interpolation=cv2.INTER_NEAREST)
        strip = np.full((18, _SIDE, 3), 255, np.uint8)
        _put_text(strip, f"{found['predicted'][index]:.1f} for {found['true'][index]:.1f} cm2", (3, 13))
        shown.append(np.concatenate([large, strip]))
    half = len(shown) // 2
    rows = [np.concatenate(shown[first : first + half], axis=1) for first in (0, half)]
    return _encode(".jpg", np.concatenate(rows))


def _put_text(image: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(image, text, at, _FONT, 0.36, _INK, 1, cv2.LINE_AA)


def _encode(suffix: str, image: np.ndarray) -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()
