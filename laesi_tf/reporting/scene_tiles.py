"""Tiles of scenes, of one scene with each component added, of lighting passes, and of masks."""

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.common.geometry import trace_polygons
from laesi_tf.common.progress import progress_bar
from laesi_tf.common.text import sanitise_text
from laesi_tf.data.decoding import decode_photo
from laesi_tf.data.letterbox import letterbox_image
from laesi_tf.data.manifest import Photo
from laesi_tf.data.prefetch import prefetch
from laesi_tf.reporting.captions import add_caption
from laesi_tf.reporting.overlay import PREDICTED_COLOUR, draw_outlines
from laesi_tf.synthesis import COMPONENTS, Ranges, synthesise
from laesi_tf.synthesis.presets import enable_all_components

COLUMNS = 6
PASSES = 4
_LEAVES = 6
_CANDIDATES = 24
"""Scenes among which that of `component_tiles` is chosen."""


@dataclass(frozen=True)
class RenderedScene:
    """A synthetic `image` uint8 [H, W, 3], its `mask` uint8 [H, W] 0/1, and its `label`: numbers by name."""

    image: np.ndarray
    mask: np.ndarray
    label: dict[str, float]


def render_scenes(ranges: Ranges, *, seed: int, count: int, size: int) -> list[RenderedScene]:
    """Render scenes with `count` different leaves, `size` pixels a side."""
    one_pass = ranges.with_passes(1)
    return [_render(one_pass, seed, index, size) for index in progress_bar(range(count), desc="scenes")]


def component_tiles(ranges: Ranges, *, seed: int, size: int) -> list[np.ndarray]:
    """Render one scene with leaf and sheet only, then with each component of `ranges` added: tiles [H, W, 3].

    The scene is the first in which every component is visible, or the one of 24 in which most are.
    """
    names = [name for name in _VISIBLE_ORDER if ranges.has(name)]
    strong = _exaggerate_components(ranges)
    best: list[np.ndarray] = []
    most = -1
    for index in progress_bar(range(_CANDIDATES), desc="components"):
        stages = [
            _render(_keep_components(strong, names[:n]), seed, index, size).image
            for n in range(len(names) + 1)
        ]
        visible = sum(_is_visibly_different(before, after) for before, after in itertools.pairwise(stages))
        if visible > most:
            best, most = stages, visible
        if most == len(names):
            break
    captions = ["leaf and sheet", *(f"+ {name.replace('_', ' ')}" for name in names)]
    return [add_caption(image, [caption]) for image, caption in zip(best, captions, strict=True)]


def lighting_tiles(ranges: Ranges, *, seed: int, size: int) -> list[np.ndarray]:
    """Render leaves, each under its lighting passes: tiles [H, W, 3], one leaf per row of PASSES tiles."""
    several = ranges.with_passes(PASSES)
    scenes = [_render(several, seed, i, size) for i in progress_bar(range(_LEAVES * PASSES), desc="passes")]
    return [
        add_caption(scene.image, [f"leaf {i // PASSES + 1}, light {i % PASSES + 1}"])
        for i, scene in enumerate(scenes)
    ]


# Relief before undulation: without relief shading, height is invisible.
_VISIBLE_ORDER = tuple(
    name
    for component in COMPONENTS
    if component != "undulation"
    for name in ((component, "undulation") if component == "relief" else (component,))
)


def _exaggerate_components(ranges: Ranges) -> Ranges:
    """Return `ranges` with every component present, strong, and within the image."""
    full = enable_all_components(ranges.with_passes(1))
    return dataclasses.replace(
        full,
        camera=dataclasses.replace(full.camera, fill=(0.4, 0.45), blur_mm=(0.2, 0.25), noise=(0.02, 0.035)),
        props=dataclasses.replace(full.props, gap_mm=(2, 5), fragment_mm=(20, 40), handwriting_mm=(20, 34)),
        paper=dataclasses.replace(full.paper, left=(5, 25), top=(5, 25), crease_depth=(0.1, 0.14)),
        surface=dataclasses.replace(full.surface, undulation=(0.7, 1.0), spot_threshold=(0.45, 0.55)),
        light=dataclasses.replace(full.light, relief=(0.6, 0.9), strength=(0.4, 0.6), cast_strength=0.2),
    )


def _keep_components(ranges: Ranges, names: Sequence[str]) -> Ranges:
    return dataclasses.replace(ranges, without=frozenset(COMPONENTS) - frozenset(names))


def _is_visibly_different(before: np.ndarray, after: np.ndarray) -> bool:
    """Return whether two images [H, W, 3] differ visibly: by 3 of 256 levels in 0.2 % of the pixels."""
    change = np.abs(before.astype(np.int16) - after).max(axis=-1)
    return bool(np.mean(change >= 3) > 0.002)


def _render(ranges: Ranges, seed: int, index: int, size: int) -> RenderedScene:
    # Called eagerly: tracing a graph takes as long as two dozen images.
    sample = synthesise(seed, size=(size, size), ranges=ranges, index=index)
    label = {name: sample[name].numpy().item() for name in ("index", "area_cm2", "px_per_mm", "tilt_deg")}
    return RenderedScene(sample["image"].numpy(), sample["mask"].numpy(), label)


def scene_tiles(scenes: Sequence[RenderedScene]) -> list[np.ndarray]:
    """Return the images of `scenes` with their index as caption."""
    return [add_caption(scene.image, [f"scene {scene.label['index']}"]) for scene in scenes]


def mask_tiles(scenes: Sequence[RenderedScene]) -> list[np.ndarray]:
    """Return the images of `scenes` with the outline of the mask, and the label as caption."""
    tiles = []
    for scene in scenes:
        polygons = trace_polygons(scene.mask > 0)
        outlines = [(ring, PREDICTED_COLOUR) for polygon in polygons for ring in polygon.rings]
        caption = "{area_cm2:.2f} cm², {px_per_mm:.2f} px/mm, tilt {tilt_deg:.0f}°".format_map(scene.label)
        tiles.append(add_caption(draw_outlines(scene.image, outlines), [caption]))
    return tiles


def photo_tiles(photos: Sequence[Photo], size: int) -> list[np.ndarray]:
    """Return photos at the scenes' size; an unreadable photo is a blank tile with a message."""
    tiles = []
    for photo, image in prefetch(lambda photo: decode_photo(photo.image), photos):
        name = sanitise_text(Path(photo.name).name)
        if isinstance(image, InputError):
            tiles.append(add_caption(np.full((size, size, 3), 230, np.uint8), [f"cannot be read: {name}"]))
        else:
            tiles.append(add_caption(letterbox_image(image, (size, size))[0], [f"photo {name}"]))
    return tiles
