"""Read the ruling once more around the largest leaf, where the whole photo says nothing or misleads.

A small sheet on a large desk fills few cells of the overview, and a cloth of large checks more than the sheet
does. Around the leaf is little but its paper, and a large photo has more pixels of it than the overview.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from laesi_tf.common.sheet_model import FOCAL
from laesi_tf.estimators.boxes import box_around
from laesi_tf.estimators.leaf_outline import LeafOutline
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling.judge import SheetReading
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.models.ruling_cells import FRAME_PX


@dataclass(frozen=True, kw_only=True)
class CloserReadingParams:
    """Parameters of the second reading."""

    margin: float = parameter(
        0.4,
        unit="leaf lengths",
        set_on="phone scenes of seeds 81, 82 (millimetres) and 90 (all papers); 2026-12-01",
    )
    """So much is seen on each side of the leaf; less shows too few lines, more shows the desk again."""


def read_around_largest(
    reader: SheetReader,
    outlines: Sequence[LeafOutline],
    before: SheetReading,
    pyramid: PhotoPyramid,
    grid_mm: float | None,
    params: CloserReadingParams,
) -> SheetReading | None:
    """Return a reading of the paper around the largest of `outlines`; None where it is not believed.

    `before` is that of the whole photo. If it has a plane of lines in it, of which this part shows fewer,
    only lines that prove millimetres contradict it. `grid_mm` is as for `SheetReader.read`.
    """
    if not outlines:
        return None
    leaf = max(outlines, key=lambda outline: outline.area_px).polygon.outer
    box = box_around(leaf, params.margin * np.ptp(leaf, axis=0).max())
    part = pyramid.crop_around(box, min_side=FRAME_PX, max_side=FRAME_PX)
    closer = reader.read(part, grid_mm=grid_mm)
    if closer.camera is None or (before.paper and not closer.proves_millimetres):
        return None
    sides = pyramid.size.xy.max(), (part.size.xy * part.pixel_size).max()
    camera = dataclasses.replace(closer.camera, focal=FOCAL * float(sides[0] / sides[1]))
    return dataclasses.replace(closer, camera=camera)
