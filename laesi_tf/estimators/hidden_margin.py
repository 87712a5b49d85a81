"""Margins of leaves that have the colour of paper: they are known by the print that they hide."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from laesi_tf.common.arrays import Mask, Points
from laesi_tf.common.geometry import Polygon, trace_polygons
from laesi_tf.estimators.boxes import box_around
from laesi_tf.estimators.leaf_outline import LeafOutline, paint_masks
from laesi_tf.estimators.mask_shapes import (
    close_mask,
    distance_inside,
    grow_mask,
    make_disc,
    make_square,
    open_mask,
)
from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.photo_pyramid import Crop, PhotoPyramid, shrink
from laesi_tf.estimators.print_visibility import (
    SET_ON,
    PrintVisibility,
    PrintVisibilityParams,
    measure_visibility,
)
from laesi_tf.estimators.ruling.sheet_camera import SheetCamera
from laesi_tf.estimators.sheet_colour import compare_with_paper

_TOUCHING_PX = 3
"""Things at most so far from a leaf touch it."""
_MARGIN_LINES = 4
"""A margin may always be so many finest lines wide, on narrow leaves, too."""
_LEAST_LINES = 8
"""Paper of at least so many finest lines around a leaf is compared."""


@dataclass(frozen=True, kw_only=True)
class HiddenMarginParams:
    """Parameters of margins that have the colour of paper."""

    visibility: PrintVisibilityParams = field(default_factory=PrintVisibilityParams)
    room: float = parameter(0.3, unit="share of the leaf's longer side", set_on=SET_ON)
    """The paper around the leaf is compared up to this distance."""
    side_px: int = parameter(640, unit="pixels", set_on=SET_ON)
    """Longer side of that crop at most."""
    line_px: float = parameter(5.0, unit="pixels per finest line", set_on=SET_ON)
    """More pixels show no more of the print."""
    hidden_below: float = parameter(0.5, unit="share of the print's contrast", set_on="halfway")
    """Where less of the print is seen, it is hidden."""
    least_width: float = parameter(0.7, unit="finest lines", set_on=SET_ON)
    """A margin is at least so wide: blur hides the print beside any leaf."""
    greatest_width: float = parameter(0.35, unit="share of the leaf's width", set_on=SET_ON)
    """A margin is at most so wide; labels and fingers reach farther."""
    least_energy: float = parameter(0.35, unit="mean of the bare paper", set_on=SET_ON)
    """A margin hides at least so much print: between heavier lines there is little, which shadows hide."""
    least_contact: float = parameter(0.08, unit="share of the leaf's outline", set_on=SET_ON)
    """Each part of a margin runs at least so far along the leaf, as gloss and folds do not."""
    least_total_contact: float = parameter(0.25, unit="share of the leaf's outline", set_on=SET_ON)
    """The whole margin does so at least so far."""
    least_area: float = parameter(0.02, unit="share of the leaf", set_on=SET_ON)
    """A margin has at least so much of the leaf's area."""
    least_thing: float = parameter(0.1, unit="share of the leaf", set_on=SET_ON)
    """Other things that hide the print beside a leaf are noted from this area on."""
    max_tint: float = parameter(30.0, unit="CIELAB", set_on=SET_ON)
    """A margin that has the paper's colour differs from it by at most so much in hue and saturation."""
    max_shade: float = parameter(0.4, unit="ln of lightness", set_on=SET_ON)
    """The same in lightness: strokes of a pen are darker."""
    least_visible: float = parameter(0.9, unit="share of the paper around", set_on=SET_ON)
    """Nothing is added where the print is not seen on so much of the bare paper."""
    edge_sd: float = parameter(
        0.4, unit="finest lines", set_on="two pale margins, of cases and of a scene, 2026-11-30"
    )
    """Standard deviation of the position of a margin's whole edge."""


def add_hidden_margin(
    outline: LeafOutline,
    others: Sequence[Points],
    sheet: Points,
    camera: SheetCamera,
    pyramid: PhotoPyramid,
    params: HiddenMarginParams,
) -> LeafOutline:
    """Return `outline` with the margin beside it that hides the print.

    Where something else hides it beside the leaf, be it the leaf's other half or a label, the outline
    `is_touched`. `others` are the outlines [n, 2] of other leaves, `sheet` is that of the ruled part, convex;
    photo pixels.
    """
    leaf = outline.polygon.outer
    crop = _crop_around(leaf, camera, pyramid, params)
    own, other = crop.paint([leaf]) > 0, crop.paint(others) > 0
    hidden = grow_mask(own | other, 1)
    visibility = measure_visibility(crop, camera, camera.pitch_mm, hidden, params.visibility)
    if visibility is None:
        return outline
    line = visibility.px_per_line
    ruled = distance_inside(crop.paint([sheet]) > 0) > line
    covered = _find_covered(visibility, own, hidden, ruled, params)
    bare = ruled & visibility.is_known & (distance_inside(~(own | covered)) > 2 * line)
    if not bare.any() or (visibility.share[bare] > params.hidden_below).mean() < params.least_visible:
        return outline
    tint, shade = compare_with_paper(crop.image, bare)
    paper_like = (tint < params.max_tint) & (np.abs(shade) < params.max_shade)
    margin, thing = _choose_margin(covered, own, other, visibility, paper_like, params)
    leaf_px = np.count_nonzero(own)
    if np.count_nonzero(margin) >= params.least_area * leaf_px:
        margin |= grow_mask(margin, 2) & hidden & ~own & ~other
        return _join(outline, margin, crop, pyramid, params.edge_sd * line)
    is_beside_thing = bool(np.count_nonzero(thing) >= params.least_thing * leaf_px)
    return dataclasses.replace(outline, is_touched=outline.is_touched or is_beside_thing)


def _crop_around(
    leaf: Points, camera: SheetCamera, pyramid: PhotoPyramid, params: HiddenMarginParams
) -> Crop:
    low, high = leaf.min(axis=0), leaf.max(axis=0)
    line = camera.px_per_mm((low + high) / 2) * camera.pitch_mm
    room = max(params.room * (high - low).max(), _LEAST_LINES * line)
    side = params.side_px
    crop = pyramid.crop_around(box_around(leaf, room), min_side=side, max_side=side)
    line_px = line / float(crop.pixel_size.mean())
    return shrink(crop, max(1, int(max(crop.size) * min(1.0, params.line_px / line_px))))


def _find_covered(
    visibility: PrintVisibility, own: Mask, hidden: Mask, ruled: Mask, params: HiddenMarginParams
) -> Mask:
    """Return where the print is hidden beside a leaf, bool [h, w], without what is narrower than a margin."""
    covered = visibility.is_known & (visibility.share < params.hidden_below)
    radius = params.least_width * visibility.px_per_line / 2
    disc, wide = make_disc(radius), make_disc(2 * radius)
    closed = close_mask(covered | own, wide)
    # Bays between the leaf's own lobes are not closed.
    closed &= covered | ~close_mask(own, wide)
    closed &= ~hidden & ruled
    return open_mask(closed, disc)


def _choose_margin(
    covered: Mask,
    own: Mask,
    other: Mask,
    visibility: PrintVisibility,
    paper_like: Mask,
    params: HiddenMarginParams,
) -> tuple[Mask, Mask]:
    """Return the parts of `covered`, bool [h, w], that lie along the leaf like a margin, and other things
    that touch it.

    `own` is the leaf, `other` are other leaves, `paper_like` has the paper's colour. There is no margin
    unless some of its parts are long enough to be sure.
    """
    count, labels = cv2.connectedComponents(covered.astype(np.uint8))
    _, sides, _ = cv2.minAreaRect(cv2.findNonZero(own.astype(np.uint8)))
    greatest_px = max(params.greatest_width * float(np.min(sides)), _MARGIN_LINES * visibility.px_per_line)
    limit = distance_inside(~own) > greatest_px
    limit |= grow_mask(other, _TOUCHING_PX)
    limit[[0, -1]] = True
    limit[:, [0, -1]] = True
    may_be_margin = np.bincount(labels[limit], minlength=count) == 0
    may_be_margin[0] = False
    sizes = np.maximum(np.bincount(labels.ravel(), minlength=count), 1)
    energy, alike = (
        np.bincount(labels.ravel(), values.ravel(), count) / sizes
        for values in (visibility.energy, paper_like)
    )
    may_be_margin &= alike > 0.5
    is_sure = energy > params.least_energy
    ring = grow_mask(own, 1) & ~own
    # Where two parts touch the same pixel, one of them counts.
    touching = cv2.dilate(labels.astype(np.float32), make_square(_TOUCHING_PX))[ring].astype(int)
    contact = np.bincount(touching, minlength=count) / max(int(np.count_nonzero(ring)), 1)
    is_sure &= contact > params.least_contact
    is_sure[0] = False
    has_margin = contact[is_sure & may_be_margin].sum() >= params.least_total_contact
    return (may_be_margin & (contact > 0) & has_margin)[labels], (is_sure & ~may_be_margin)[labels]


def _join(
    outline: LeafOutline, margin: Mask, crop: Crop, pyramid: PhotoPyramid, edge_sd: float
) -> LeafOutline:
    """Return `outline` with `margin`, bool [h, w] in `crop`, whose edge is known within `edge_sd` pixels."""
    corners = [part.to_photo(np.stack([np.zeros(2), part.size.xy])) for part in (crop, outline.crop)]
    box = np.stack([np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))])
    side = max(outline.mask.shape)
    target = pyramid.crop_around(box, min_side=side, max_side=2 * side)
    leaf, added = (paint_masks([placed], target) for placed in (outline.placed_mask, (crop, margin)))
    # Where both meet, one of them has coarser pixels.
    mask = leaf | (close_mask(leaf | added, make_disc(2.0)) & grow_mask(added, 4))
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    mask &= labels == np.bincount(labels[leaf]).argmax()
    outer, *holes = (target.to_photo(ring) for ring in trace_polygons(mask)[0].rings)
    contours, _ = cv2.findContours(margin.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    # Half of a margin's outline is its edge; the other half is the leaf's.
    edge = sum(cv2.arcLength(contour, True) for contour in contours) / 2
    area_sd = edge_sd * edge * float(crop.pixel_size.prod())
    return dataclasses.replace(
        outline,
        crop=target,
        mask=mask,
        polygon=Polygon(outer, tuple(holes)),
        area_sd_px=float(np.hypot(outline.area_sd_px, area_sd)),
        has_hidden_margin=True,
    )
