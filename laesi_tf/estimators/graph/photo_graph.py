"""A photo's measurement as one graph: from pixels in a frame to areas or a refusal."""

from dataclasses import dataclass, field
from typing import Any

import keras
import numpy as np
import tensorflow as tf
import tensorflow.experimental.numpy as tnp

from laesi_tf.common.sheet_model import COUNT, FOCAL
from laesi_tf.estimators.graph.close_looks import (
    MAX_LEAVES,
    CloseLookParams,
    Found,
    confirm_leaves,
    find_leaves,
)
from laesi_tf.estimators.graph.components import find_ends
from laesi_tf.estimators.graph.crops import make_levels
from laesi_tf.estimators.graph.edge_refinement import FINE, refine_leaves
from laesi_tf.estimators.graph.leaf_measures import (
    LeafMeasureParams,
    Sheet,
    choose_distinct,
    measure_leaves,
    measure_share_on,
)
from laesi_tf.estimators.graph.leaf_shapes import choose_leaves
from laesi_tf.estimators.ruling.camera_ops import measure_scale_error, measure_tilt
from laesi_tf.estimators.ruling.codes import CUT_OFF, Refusal
from laesi_tf.estimators.ruling.ruling_graph import RulingGraph
from laesi_tf.estimators.ruling.stage import inline_stages
from laesi_tf.estimators.ruling.verdict import decide_refusal, find_finest_period, note_pitch
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
        found, counts = self._find_leaves(levels, size, reading.votes.agreement)
        on_sheet = measure_share_on(
            found, reading.votes.agreement, least=params.ruling.sheet_agreement, cell_px=CELL_PX
        )
        lies = (on_sheet >= params.on_sheet) | ~is_fitted
        beside = tf.reduce_sum(tf.cast(counts & ~lies, tf.int32))
        refusal = tf.where(
            tf.equal(refusal, int(Refusal.NONE)) & ~tf.reduce_any(counts & lies),
            tf.where(beside > 0, int(Refusal.NO_LEAF_ON_SHEET), int(Refusal.NO_LEAF)),
            refusal,
        )
        found, is_leaf = put_first(found, counts & lies)
        is_measured = is_leaf & tf.equal(refusal, int(Refusal.NONE))
        looks = self.params.looks
        number = tf.reduce_sum(tf.cast(is_leaf, tf.int32))
        found, expected_errors = refine_leaves(
            levels, size, found, number, self._network, looks.detector, looks.refinement
        )
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
            "flags": tf.cast(is_leaf & leaves.is_cut_off, tf.int32) * CUT_OFF,
            "square": only(found.square, is_leaf[:, None]),
            "mask": tf.cast(tf.round(255 * only(found.leaf, is_leaf[:, None, None])), tf.uint8),
            "count": number,
            "beside": beside,
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

    def _find_leaves(
        self, levels: list[tf.Tensor], size: tf.Tensor, agreement: tf.Tensor
    ) -> tuple[Found, tf.Tensor]:
        """Return what was found and which of it are leaves, bool [MAX_LEAVES]."""
        looks, options = self.params.looks, {"side": self._side}
        overviews, count = self._choose_overviews(agreement, size)
        found = find_leaves(levels, size, overviews, count, self._network, params=looks, **options)
        found, counts = put_first(*choose_distinct(found, looks.detector))
        count = tf.reduce_sum(tf.cast(counts, tf.int32))
        counts &= confirm_leaves(levels, size, found, count, self._network, params=looks.detector, **options)
        return found, choose_leaves(found, counts, self.params.estimator.mask.outline)

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


def put_first(found: Found, counts: tf.Tensor) -> tuple[Found, tf.Tensor]:
    """Return the leaves that `counts` [L] before the others, by falling area, and which they are."""
    scores, order = tf.math.top_k(tf.where(counts, found.area, 0.0), MAX_LEAVES)
    return Found(*(tf.gather(part, order) for part in found)), scores > 0


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
