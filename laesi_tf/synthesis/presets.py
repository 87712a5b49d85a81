"""Named ranges, and ranges in which every component is present."""

import dataclasses
from typing import Any

from laesi_tf.synthesis.paper.params import PaperParams
from laesi_tf.synthesis.ranges import Probability, fields_of
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
PRESETS: dict[str, Ranges] = {"rendering_1": RENDERING_1, "rendering_2": RENDERING_2}
"""The paper's two: "Rendering 2" narrows the noise of the paper model, nothing else (section 4.3)."""


def enable_all_components(ranges: Ranges) -> Ranges:
    """Return `ranges` with every Probability above 0 at 1: each image has all components that it can have."""
    return dataclasses.replace(
        ranges,
        leaf={name: (weight, _make_certain(kind)) for name, (weight, kind) in ranges.leaf.items()},
        **{name: _make_certain(getattr(ranges, name)) for name in PARTS},
    )


def _make_certain(params: Any) -> Any:
    chances = [
        name for name, range_ in fields_of(params).items() if isinstance(range_, Probability) and range_.p > 0
    ]
    return dataclasses.replace(params, **dict.fromkeys(chances, Probability(1.0)))
