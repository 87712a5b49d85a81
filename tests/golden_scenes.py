"""The twelve golden scenes: what a seed must keep giving, and the command that writes it down anew.

    python tests/golden_scenes.py

writes `golden/scenes.npz`. Run it only in a commit that changes the scenes of a seed on purpose.
"""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import tensorflow as tf
from scenes import complete

from laesi_tf.synthesis import Ranges, load_ranges, synthesise

FILE = Path(__file__).parent / "golden" / "scenes.npz"
SEED = 20240617
_LEVELS = 16
_BLOCK = 8


@dataclasses.dataclass(frozen=True)
class Summary:
    """What is kept of a scene: numbers [13] (area in cm2, px/mm, tilt in degrees, kind, homography), mask
    bool [H, W], and block means of the image in steps of 1/16: uint8 [H / 8, W / 8, 3]."""

    numbers: np.ndarray
    mask: np.ndarray
    thumbnail: np.ndarray


def render() -> Iterator[tuple[str, Summary]]:
    """Render the golden scenes: both presets as drawn and with all components, and an oblong image.

    Each variant and shape is compiled anew, so there are three.
    """
    for preset in ("rendering_1", "rendering_2"):
        ranges = load_ranges(preset).with_passes(1)
        yield from _render(f"{preset}-drawn", ranges, (96, 96), 3)
        yield from _render(f"{preset}-complete", complete(ranges), (96, 96), 2)
    yield from _render("rendering_2-oblong", ranges, (128, 96), 2)


def _render(name: str, ranges: Ranges, size: tuple[int, int], count: int) -> Iterator[tuple[str, Summary]]:
    for index in range(count):
        yield f"{name}-{index}", summarise(synthesise(SEED, size=size, ranges=ranges, index=index))


def summarise(sample: dict[str, tf.Tensor]) -> Summary:
    """Keep of a `synthesise` result what a change that keeps behaviour may not alter."""
    image = sample["image"].numpy()
    small = (image.shape[1] // _BLOCK, image.shape[0] // _BLOCK)
    means = cv2.resize(image.astype(np.float32), small, interpolation=cv2.INTER_AREA)
    names = ("area_cm2", "px_per_mm", "tilt_deg", "kind")
    numbers = [float(sample[name]) for name in names] + sample["to_px"].numpy().ravel().tolist()
    return Summary(
        np.array(numbers, np.float32),
        sample["mask"].numpy() > 0,
        np.round(means * (_LEVELS / 256)).astype(np.uint8),
    )


def read() -> dict[str, Summary]:
    """Return the golden scenes by name."""
    with np.load(FILE) as stored:
        names = sorted({key.partition("/")[0] for key in stored})
        return {name: Summary(*(stored[f"{name}/{field}"] for field in _FIELDS)) for name in names}


_FIELDS = tuple(field.name for field in dataclasses.fields(Summary))


def main() -> None:
    """Write the golden file."""
    FILE.parent.mkdir(exist_ok=True)
    arrays = {f"{name}/{field}": getattr(summary, field) for name, summary in render() for field in _FIELDS}
    np.savez_compressed(FILE, **arrays)
    print(f"{FILE}: {len(arrays) // len(_FIELDS)} scenes, {FILE.stat().st_size / 1024:.0f} kB")


if __name__ == "__main__":
    main()
