"""A photo's measurement as one graph: from pixels in a frame to areas or a refusal."""

from dataclasses import dataclass, field
from typing import Any

import keras
import numpy as np
import tensorflow as tf
import tensorflow.experimental.numpy as tnp

from laesi_tf.common.sheet_model import COUNT, FOCAL
from laesi_tf.estimators.graph.close_looks import MAX_LEAVES, CloseLookParams
from laesi_tf.estimators.graph.components import find_ends
from laesi_tf.estimators.graph.crops import make_levels
from laesi_tf.estimators.graph.edge_refinement import FINE, refine_leaves
from laesi_tf.estimators.graph.leaf_measures import (
    LeafMeasureParams,
    Sheet,
    measure_leaves,
    measure_share_on,
)
from laesi_tf.estimators.graph.leaf_search import (
    Search,
    count_uncounted,
    put_first,
    reaches_border,
    search_leaves,
    take_first,
)
from laesi_tf.estimators.graph.overview_colours import Overview, Things, make_overview, paint_leaves
from laesi_tf.estimators.graph.surroundings import choose_on_sheet, measure_likeness
from laesi_tf.estimators.ruling.camera_ops import measure_scale_error, measure_tilt
from laesi_tf.estimators.ruling.codes import CUT_OFF, TOUCHED, Refusal
from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
from laesi_tf.estimators.ruling.stage import inline_stages
from laesi_tf.estimators.ruling.verdict import choose_first, decide_refusal, find_finest_period, note_pitch
from laesi_tf.estimators.ruling_estimator import RulingEstimatorParams
from laesi_tf.models.inference import freeze_network
from laesi_tf.models.ruling_cells import CELL_PX, FRAME_PX

GRID_NODES = 33
"""Points along each side of the photo at which the graph says where the printed lines lie."""


@dataclass(frozen=True, kw_only=True)
class PhotoGraphParams:
    """Parameters of the graph's own stages, and those of the estimator whose rules it follows."""

    looks: CloseLookParams = field(default_factory=CloseLookParams)
    measures: LeafMeasureParams = field(default_factory=LeafMeasureParams)
    estimator: RulingEstimatorParams = field(default_factory=RulingEstimatorParams)


class PhotoGraph(tf.Module):
    """Measures photos in a frame with a mask and a ruling network."""

    def __init__(
        self, mask_network: keras.Model, reader: RulingGraph, params: PhotoGraphParams | None = None
    ) -> None:
        """Take a mask network of a square input and a reader of rulings."""
        super().__init__(name="photo_graph")
        self.params = params or PhotoGraphParams()
        self._side = mask_network.input_shape[1]
        self._network = freeze_network(mask_network)
        self._reader = reader.with_network(freeze_network)

    @tf.function(
        autograph=False,
        input_signature=[
            tf.TensorSpec([FRAME_PX, FRAME_PX, 3], tf.uint8, "photo"),
            tf.TensorSpec([2], tf.int32, "size"),
            tf.TensorSpec([], tf.float32, "grid_mm"),
            tf.TensorSpec([], tf.float32, "px_per_mm"),
        ],
    )
    def measure(
        self, photo: tf.Tensor, size: tf.Tensor, grid_mm: tf.Tensor, px_per_mm: tf.Tensor
    ) -> dict[str, tf.Tensor]:
        """Measure the photo of `size` (height, width) in the upper left corner of `photo`, zeros elsewhere.

        `grid_mm` is the distance of the finest lines where it is known, else 0; `px_per_mm` the scale in
        pixels of the frame where it is known, else 0, and then the ruling is read. The result is described in
        `exporting.litert`.
        """
        with inline_stages():
            return self._measure(photo, tf.cast(size, tf.float32), grid_mm, px_per_mm)

    def _measure(
        self, photo: tf.Tensor, size: tf.Tensor, grid_mm: tf.Tensor, px_per_mm: tf.Tensor
    ) -> dict[str, tf.Tensor]:
        params = self.params.estimator
        is_known = px_per_mm > 0
        reading = self._reader.read_frame(photo, size)
        refusal = decide_refusal(reading, size, grid_mm, params=params.ruling.judge)
        refusal = tf.where(is_known, int(Refusal.NONE), refusal)
        # A scale that is given is that of a flat sheet with lines a millimetre apart.
        straight = px_per_mm_to_sheet(px_per_mm, size)
        is_fitted = tf.equal(refusal, int(Refusal.NONE)) & ~is_known
        parameters = tf.where(is_fitted, reading.fit.parameters, straight)
        covariance = tf.where(is_fitted, reading.fit.covariance, 0.0)
        phase_error = tf.where(is_fitted, reading.fit.phase_error, 0.0)
        pitch = tf.where(is_fitted & (grid_mm > 0), grid_mm, 1.0)
        sheet = Sheet(parameters, pitch, size)
        levels = make_levels(photo, self._side)
        overview = make_overview(levels, size, self._side)
        search = self._search(levels, size, overview, reading.votes.agreement)
        lies = self._find_on_sheet(overview, search, reading.votes.agreement, size) | ~is_fitted
        found, is_leaf = put_first(search.found, search.counts & lies)
        number = tf.reduce_sum(tf.cast(is_leaf, tf.int32))
        refined = refine_leaves(
            levels, size, found, number, self._network, self.params.looks.detector, params.mask.outline
        )
        # Parts of pens and notes look like leaves in some crops, but continue beyond their outlines.
        is_part = refined.is_touched & (tf.range(MAX_LEAVES) > 0)
        (found, expected_errors, is_touched), is_leaf = take_first(refined, is_leaf & ~is_part)
        number = tf.reduce_sum(tf.cast(is_leaf, tf.int32))
        beside = tf.reduce_sum(tf.cast(search.counts, tf.int32)) - number
        uncounted, uncounted_px = self._count_uncounted(search.things, reading.votes.agreement)
        counted_px = tf.reduce_sum(tf.where(is_leaf, found.area, 0.0))
        # Without a ruling nothing is known to lie on a sheet.
        uncounted = tf.where(is_fitted, uncounted, 0)
        uncounted_share = tf.where(is_fitted, uncounted_px, 0.0) / tf.maximum(counted_px, 1.0)
        reasons = [
            (tf.equal(number, 0) & (beside > 0), int(Refusal.NO_LEAF_ON_SHEET)),
            (tf.equal(number, 0), int(Refusal.NO_LEAF)),
            (uncounted_share > params.most_uncounted, int(Refusal.MOSTLY_UNCOUNTED)),
        ]
        is_read = tf.equal(refusal, int(Refusal.NONE))
        refusal = tf.where(is_read, choose_first(reasons, Refusal.NONE), refusal)
        is_measured = is_leaf & tf.equal(refusal, int(Refusal.NONE))
        leaves = measure_leaves(found, sheet, self.params.measures)
        scale = tf.sqrt(1 / tf.maximum(sheet.mm2_per_px(leaves.middle), 1e-12))
        distance_mm = FOCAL * tf.reduce_max(size) / scale
        lift = tf.where(is_fitted, tf.maximum(1 - params.lift_mm / distance_mm, 0.0), 1.0)
        scale_error = measure_scale_error(
            parameters,
            covariance,
            phase_error,
            sheet.normalise(leaves.middle),
            params.ruling.judge.scale_error,
            tnp,
        )
        area = leaves.area_mm2 * lift**2 / 100
        # As of LeafOutline.measure.
        outline, fine_mm2 = params.mask.outline, leaves.px_mm2 / FINE**2
        of_errors = outline.error_sd * expected_errors * fine_mm2
        of_pixels = outline.edge_sd_px * FINE * leaves.perimeter_px * fine_mm2
        of_edge = outline.edge_sd_mm * leaves.perimeter_px * tf.sqrt(leaves.px_mm2)
        of_outline = (of_errors**2 + of_pixels**2 + of_edge**2) * (lift**2 / 100) ** 2
        of_sheet = tf.where(is_fitted, params.sheet_variance(area, scale_error, distance_mm), 0.0)
        uncertainty = tf.sqrt(of_outline + of_sheet)

        def only(values: tf.Tensor, where: tf.Tensor) -> tf.Tensor:
            return tf.where(where, values, tf.zeros_like(values))

        return {
            "area_cm2": only(area, is_measured),
            "uncertainty_cm2": only(uncertainty, is_measured),
            "length_mm": only(leaves.length_mm * lift, is_measured),
            "width_mm": only(leaves.width_mm * lift, is_measured),
            "leaf_px_per_mm": only(scale, is_measured),
            "flags": tf.cast(is_leaf & leaves.is_cut_off, tf.int32) * CUT_OFF
            + tf.cast(is_leaf & is_touched, tf.int32) * TOUCHED,
            "square": only(found.square, is_leaf[:, None]),
            "mask": tf.cast(tf.round(255 * only(found.leaf, is_leaf[:, None, None])), tf.uint8),
            "count": number,
            "beside": beside,
            "uncounted": uncounted,
            "uncounted_share": uncounted_share,
            "refusal": refusal,
            "note": tf.where(is_fitted, note_pitch(reading, grid_mm), 0),
            "px_per_mm": tf.gather(only(scale, is_measured), 0),
            "tilt_deg": tf.where(is_fitted, measure_tilt(parameters, tnp), 0.0),
            "confidence": self._rate_fit(reading, is_fitted),
            "sheet": tf.where(is_fitted, parameters, 0.0),
            "grid": only(sheet.to_lines(place_nodes(size)), is_fitted),
            "pitch_mm": tf.where(is_fitted, pitch, 0.0),
            "period_px": find_finest_period(reading),
        }

    def _search(
        self, levels: list[tf.Tensor], size: tf.Tensor, overview: Overview, agreement: tf.Tensor
    ) -> Search:
        """Return what is found on the photo, the largest leaves first."""
        boxes, count = self._choose_overviews(agreement, size)
        outline = self.params.estimator.mask.outline
        search = search_leaves(
            levels, size, boxes, count, self._network, overview, params=self.params.looks, outline=outline
        )
        found, counts = put_first(search.found, search.counts)
        return search._replace(found=found, counts=counts)

    def _find_on_sheet(
        self, overview: Overview, search: Search, agreement: tf.Tensor, size: tf.Tensor
    ) -> tf.Tensor:
        """Return which of the leaves of a `search` lie on the sheet, bool [MAX_LEAVES]."""
        params, found, counts = self.params.estimator, search.found, search.counts
        least = params.ruling.sheet_agreement
        painted = paint_leaves(overview, found, counts)
        border = self.params.measures.border_px * found.square[:, 2:] / self._side
        return choose_on_sheet(
            counts,
            measure_share_on(found, agreement, least=least, cell_px=CELL_PX),
            measure_likeness(overview, painted, agreement > least, CELL_PX, params.sheet),
            on_sheet=params.on_sheet,
            is_cut_off=reaches_border(found.box, size, border),
            params=params.sheet,
        )

    def _count_uncounted(self, things: Things, agreement: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        """Return the number of `things` on the sheet that are none of the leaves, and their area."""
        params = self.params.estimator
        return count_uncounted(
            things,
            agreement,
            least=params.ruling.sheet_agreement,
            cell_px=CELL_PX,
            on_sheet=params.on_sheet,
            params=self.params.looks,
            outline=params.mask.outline,
        )

    def _choose_overviews(self, agreement: tf.Tensor, size: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        """Return boxes [2, 4] in which to search, the photo and the ruled sheet, and how many are of use: the
        second where it is much smaller.

        `agreement` [C, C] is that of the votes.
        """
        whole = tf.concat([[0.0, 0.0], tf.reverse(size, [0])], 0)
        is_ruled = tf.cast(agreement > self.params.estimator.ruling.sheet_agreement, tf.float32)
        (left, right), (top, bottom) = (find_ends(tf.reduce_max(is_ruled, axis)) for axis in (0, 1))
        cells = tf.stack([left, top, right, bottom]) * CELL_PX
        ruled = tf.maximum(tf.minimum(cells, tf.tile(tf.reverse(size, [0]), [2])), 0.0)
        side = tf.reduce_max(ruled[2:] - ruled[:2])
        is_useful = (side < self.params.looks.ruled_share * tf.reduce_max(size)) & (side > 2 * CELL_PX)
        return tf.stack([whole, ruled]), 1 + tf.cast(is_useful, tf.int32)

    def _rate_fit(self, reading: Any, is_fitted: tf.Tensor) -> tf.Tensor:
        """Return how well the printed lines follow the fit: 1 exactly, 0 as badly as is accepted."""
        worst = self.params.estimator.ruling.judge.worst_phase
        return tf.where(is_fitted, tf.maximum(0.0, 1 - reading.fit.phase_error / worst), 0.0)


def place_nodes(size: tf.Tensor) -> tf.Tensor:
    """Return points [GRID_NODES, GRID_NODES, 2] (x, y) at equal distances over a photo of `size` [2]."""
    steps = tf.constant(np.linspace(0, 1, GRID_NODES), tf.float32)
    columns, rows = tf.meshgrid(steps * size[1], steps * size[0])
    return tf.stack([columns, rows], -1)


def px_per_mm_to_sheet(px_per_mm: tf.Tensor, size: tf.Tensor) -> tf.Tensor:
    """Return the parameters [COUNT] of a flat sheet with lines a millimetre apart, seen from above."""
    scale = tf.reduce_max(size) / 2 / tf.where(px_per_mm > 0, px_per_mm, 1.0)
    axes = tf.stack([0.0, 0.0, scale, 0.0, 0.0, scale])
    return tf.concat([axes, tf.zeros([COUNT - 6])], 0)
