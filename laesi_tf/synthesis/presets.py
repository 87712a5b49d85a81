"""Named ranges, and ranges in which every component is present."""

import dataclasses
from typing import Any

from laesi_tf.synthesis.camera.params import CameraParams
from laesi_tf.synthesis.leaf.params import LEAF_KINDS
from laesi_tf.synthesis.leaf.surface import SurfaceParams
from laesi_tf.synthesis.light import LightParams
from laesi_tf.synthesis.paper.desk import DESK_NAMES, DeskParams
from laesi_tf.synthesis.paper.params import KIND_NAMES, PaperParams
from laesi_tf.synthesis.props.registry import PropsParams
from laesi_tf.synthesis.ranges import Probability, choice, fields_of
from laesi_tf.synthesis.scene import PARTS, Ranges

RENDERING_2 = Ranges()
RENDERING_1 = Ranges(
    paper=PaperParams(
        gradient_weight=(0.0, 0.2),
        voronoi_weight=(0.0, 0.16),
        simple_weight=(0.0, 0.16),
        print_wear=(0.0, 0.95),
        creased=Probability(0.4),
        crease_depth=(0.05, 0.3),
    )
)
_KINDS = {
    "millimetre": 0.62,
    "mm_1_2_10": 0.05,
    "mm_2_10": 0.06,
    "mm_4": 0.03,
    "mm_5": 0.06,
    "quarter_inch": 0.04,
    "tenth_inch": 0.04,
    "lines": 0.04,
    "plain": 0.06,
}
_DESKS = {
    "mottled": 0.14,
    "wood": 0.26,
    "woven": 0.1,
    "checked": 0.06,
    "tiles": 0.08,
    "text": 0.06,
    "dark": 0.14,
    "green": 0.08,
    "white": 0.08,
}
_CHANCES = {
    "handwriting": 0.35,
    "fragment": 0.1,
    "label": 0.2,
    "coin": 0.25,
    "pen": 0.15,
    "scribble": 0.2,
    "note": 0.25,
    "barcode": 0.1,
    "clip": 0.08,
    "ruler": 0.12,
    "pencil": 0.15,
    "finger": 0.12,
    "tape": 0.1,
    "pane": 0.1,
}
_PHONE_LEAVES = {
    name: (
        weight,
        dataclasses.replace(
            leaf,
            length_mm=(22.0, 150.0),
            petiole=(0.0, 0.45),
            petiole_width_mm=(0.6, 2.4),
            holed=Probability(0.25),
            # The thickness of a fresh leaf.
            lift_mm=(0.1, 0.3),
        ),
    )
    for name, (weight, leaf) in LEAF_KINDS.items()
}
"""Smaller leaves that have a thickness, with longer and thinner petioles, and a kind that is narrow as
grass or needles."""
_PHONE_LEAVES["linear"] = (
    0.08,
    dataclasses.replace(
        _PHONE_LEAVES["lanceolate"][1],
        length_mm=(40.0, 170.0),
        aspect=(0.018, 0.1),
        irregularity=(0.001, 0.003),
        bend=(-0.9, 0.9),
        petiole=(0.0, 0.1),
        holed=Probability(0.0),
    ),
)
PHONE = Ranges(
    leaf=_PHONE_LEAVES,
    surface=SurfaceParams(
        season=(-0.5, 0.75),
        vein_width_mm=(0.3, 1.6),
        vein_contrast=(-0.15, 0.4),
        undulation=(0.0, 2.0),
        undulation_cells=(2.0, 8.0),
        margin_browned=Probability(0.15),
        margin_pale=Probability(0.12),
        pale_mm=(0.8, 5.0),
        petiole_red=Probability(0.2),
    ),
    props=PropsParams(
        **{name: Probability(chance) for name, chance in _CHANCES.items()},
        stroke_mm=(0.25, 4.0),
        coin_brightness=(0.35, 1.15),
        coin_relief=(0.0, 0.7),
        gap_mm=(1.0, 60.0),
    ),
    paper=PaperParams(
        # White and cream paper; printed inks are not saturated.
        hue=(0.06, 0.2),
        saturation=(0.0, 0.1),
        brightness=(0.82, 1.0),
        ink_matches=Probability(0.04),
        ink_saturation=(0.1, 0.75),
        ink_darkness=(0.1, 0.75),
        strength_1mm=(0.08, 0.9),
        strength_5mm=(0.05, 1.0),
        strength_10mm=(0.05, 1.0),
        width_5mm=(0.1, 0.5),
        width_10mm=(0.1, 0.6),
        ink_spread_mm=(0.03, 0.12),
        edged=Probability(0.7),
        left=(-4, 160),
        right=(-4, 160),
        top=(-4, 160),
        bottom=(-4, 160),
        border_mm=(-12, 14),
        kind=choice(*KIND_NAMES).with_weights(**_KINDS),
        dotted=Probability(0.08),
        dot_mm=(0.2, 0.7),
        spacing_mm=(1.5, 10.0),
        cut=Probability(0.35),
        cut_left=(-0.25, 0.25),
        cut_right=(-0.25, 0.25),
        cut_top=(-0.25, 0.25),
        cut_bottom=(-0.25, 0.25),
        scrap=Probability(0.4),
        empty=Probability(0.2),
    ),
    camera=CameraParams(
        fill=(0.1, 0.88),
        closest_mm=30.0,
        farthest_mm=600.0,
        warmth=(-0.12, 0.12),
        green=(-0.025, 0.03),
        exposure=(0.5, 0.98),
        contrast=(0.88, 1.15),
        distorted=Probability(0.5),
        bent=Probability(0.3),
        sharpened=Probability(0.4),
        resized=Probability(0.4),
        is_jpeg=Probability(0.75),
    ),
    light=LightParams(
        # Blades that curl throw their shadow farther.
        offset_mm=(0.0, 6.0),
        slope=(0.0, 0.3),
        vignette=(0.0, 0.2),
        cast=Probability(0.25),
        gloss=(0.0, 0.9),
        glass=Probability(0.08),
        photographer=Probability(0.25),
        glare=Probability(0.1),
    ),
    desk=DeskParams(
        grain=(0.03, 0.4),
        kind=choice(*DESK_NAMES).with_weights(**_DESKS),
        pitch_mm=(3.0, 24.0),
        thread_mm=(0.5, 4.0),
        board_mm=(12.0, 150.0),
        tile_aspect=(1.0, 4.0),
        joint_mm=(0.4, 6.0),
        contrast=(0.15, 0.9),
    ),
)
PRESETS: dict[str, Ranges] = {"rendering_1": RENDERING_1, "rendering_2": RENDERING_2, "phone": PHONE}
"""The paper's two, of which "Rendering 2" narrows the noise of the paper model, nothing else (section 4.3);
and `phone`, what phones see."""


def enable_all_components(ranges: Ranges) -> Ranges:
    """Return `ranges` with every Probability above 0 at 1: each image has all components that it can have.

    None is empty, which would take the leaf away.
    """
    return dataclasses.replace(
        ranges.without_empty_sheets(),
        leaf={name: (weight, _make_certain(kind)) for name, (weight, kind) in ranges.leaf.items()},
        **{name: _make_certain(getattr(ranges, name)) for name in PARTS},
    )


def _make_certain(params: Any) -> Any:
    chances = [
        name for name, range_ in fields_of(params).items() if isinstance(range_, Probability) and range_.p > 0
    ]
    return dataclasses.replace(params, **dict.fromkeys(chances, Probability(1.0)))
