"""Collect the votes of all cells: the period and the direction to look for, and where to look."""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling.params import VoteParams
from laesi_tf.estimators.ruling.stage import compile_stage
from laesi_tf.models.ruling_cells import (
    BINS_PER_OCTAVE,
    CELL_PX,
    DIRECTION_BINS,
    FINEST_PX,
    FRAME_CELLS,
    LOG_STEP,
    PERIOD_BINS,
    VOTE_BINS,
    CellAnswers,
)


class Votes(NamedTuple):
    """The period that most cells vote for, and maps of the cells that agree with it."""

    period_px: tf.Tensor
    """Pixels of the frame per period, scalar."""
    rival_px: tf.Tensor
    """The next period apart from it."""
    rival_share: tf.Tensor
    """Votes of the rival over those of the winner."""
    agreeing_cells: tf.Tensor
    """Cells that agree, at the level where there are most, scalar."""
    agreement: tf.Tensor
    """[FRAME_CELLS, FRAME_CELLS], 0..1: weight of agreeing cells, mean over the levels that see any."""
    log_period: tf.Tensor
    """[FRAME_CELLS, FRAME_CELLS], ln of pixels of the frame per period, smoothed."""
    direction: tf.Tensor
    """[FRAME_CELLS, FRAME_CELLS], radians, direction across the first family's lines, in one branch."""


def count_votes(answers: list[CellAnswers], params: VoteParams) -> tf.Tensor:
    """Return votes [VOTE_BINS] for periods in pixels of the frame; a cell of level l counts 2^l times."""
    total = tf.zeros([VOTE_BINS])
    for level, cells in enumerate(answers):
        sure = tf.where(cells.readable > params.sure, cells.readable, 0.0)
        here = tf.reduce_sum(sure[..., None] * cells.periods, [0, 1]) * 2.0**level
        shift = BINS_PER_OCTAVE * level
        total += tf.pad(here, [[shift, VOTE_BINS - PERIOD_BINS - shift]])
    return total


def find_winner(total: tf.Tensor, params: VoteParams) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Return the winner's fractional bin, the rival's bin and the rival's share of the winner's votes.

    `total` [VOTE_BINS] are all votes.
    """
    kernel = np.array([0.5, 1.0, 1.0, 1.0, 0.5], np.float32)[:, None, None]
    smooth = tf.nn.conv1d(total[None, :, None], kernel, 1, "SAME")[0, :, 0]
    places = tf.range(VOTE_BINS, dtype=tf.float32)
    first = tf.cast(tf.argmax(smooth), tf.float32)
    near = tf.where(tf.abs(places - first) < 2.5, total, 0.0)
    winner = tf.reduce_sum(near * places) / tf.maximum(tf.reduce_sum(near), 1e-9)
    apart = tf.where(tf.abs(places - first) > params.apart_bins + 0.5, smooth, 0.0)
    share = tf.reduce_max(apart) / tf.maximum(tf.reduce_max(smooth), 1e-9)
    return winner, tf.cast(tf.argmax(apart), tf.float32), share


@compile_stage
def collect_votes(answers: list[CellAnswers], *, params: VoteParams) -> Votes:
    """Return the winning period among all cells of all levels, and which cells agree with it."""
    winner, rival, share = find_winner(count_votes(answers, params), params)
    turns = 2 * np.pi * np.arange(DIRECTION_BINS, dtype=np.float32) / DIRECTION_BINS
    wheel = np.stack([np.cos(turns), np.sin(turns)], 1).astype(np.float32)
    sums, counts, levels = tf.zeros([FRAME_CELLS, FRAME_CELLS, 4]), [], tf.zeros([FRAME_CELLS] * 2)
    for level, cells in enumerate(answers):
        bins = np.arange(PERIOD_BINS, dtype=np.float32) + BINS_PER_OCTAVE * level
        best = tf.cast(tf.argmax(cells.periods, -1), tf.float32) + BINS_PER_OCTAVE * level
        agrees = (tf.abs(best - winner) < params.agreeing_bins) & (cells.readable > params.sure)
        weight = tf.where(agrees, cells.readable, 0.0)
        counts.append(tf.reduce_sum(tf.cast(agrees, tf.float32)))
        near = cells.periods * tf.cast(tf.abs(bins - winner) < params.apart_bins, tf.float32)
        period = tf.reduce_sum(near * bins, -1) / (tf.reduce_sum(near, -1) + 1e-6)
        values = tf.concat(
            [
                tf.ones_like(weight)[..., None],
                period[..., None],
                tf.reduce_sum(cells.directions[..., None] * wheel, -2),
            ],
            -1,
        )
        spread = _repeat_cells(weight[..., None] * values, 2**level)
        sums += spread
        levels += tf.cast(spread[..., 0] > 0, tf.float32)
    side = params.smoothing_cells
    mean = tf.nn.avg_pool2d(sums[None], side, 1, "SAME")[0]
    whole = tf.reduce_sum(sums, [0, 1])
    overall = whole / (whole[0] + 1e-6)
    weight = mean[..., 0] + 1e-3
    log_period = ((mean[..., 1] + 1e-3 * winner) / weight) * LOG_STEP + float(np.log(FINEST_PX))
    return Votes(
        period_px=FINEST_PX * tf.exp(winner * LOG_STEP),
        rival_px=FINEST_PX * tf.exp(rival * LOG_STEP),
        rival_share=share,
        agreeing_cells=tf.reduce_max(tf.stack(counts)),
        agreement=sums[..., 0] / tf.maximum(levels, 1.0),
        log_period=log_period,
        direction=_unwrapped_direction(mean[..., 2:], overall[2:]),
    )


def _repeat_cells(values: tf.Tensor, times: int) -> tf.Tensor:
    """Return `values` [h, w, C] with each cell repeated `times` x `times`."""
    return tf.repeat(tf.repeat(values, times, 0), times, 1) if times > 1 else values


def _unwrapped_direction(vectors: tf.Tensor, overall: tf.Tensor) -> tf.Tensor:
    """Return directions in radians from `vectors` [h, w, 2] of four times the angle.

    They are within 45 degrees of `overall` [2].
    """
    common = tf.atan2(overall[1], overall[0])
    c, s = overall[0], overall[1]
    along = vectors[..., 0] * c + vectors[..., 1] * s + 1e-6
    across = vectors[..., 1] * c - vectors[..., 0] * s
    return (common + tf.atan2(across, along)) / 4


def choose_windows(
    votes: Votes, size: tf.Tensor, *, level: tf.Tensor, count: int, side_px: int, params: VoteParams
) -> tuple[tf.Tensor, tf.Tensor]:
    """Return middles [count, 2] of windows, (x, y) in frame pixels, and their weights [count].

    Middles are at whole pixels of `level`. `size` [2] is the photo's (height, width) in frame pixels, float.
    A window covers `side_px` pixels of `level`. The best covered place comes first; each next one is far from
    those chosen and well covered. A weight is 0 where all that is left overlaps with chosen windows by more
    than 60 %.
    """
    step = tf.pow(2.0, tf.cast(level, tf.float32))
    half = side_px / 2 * step
    places = (tf.range(FRAME_CELLS, dtype=tf.float32) + 0.5) * CELL_PX

    def within(side: tf.Tensor) -> tf.Tensor:
        """Return middles of cells moved so that the window is in the photo, at whole pixels of the level."""
        clipped = tf.clip_by_value(places, half, tf.maximum(half, side - half))
        return tf.floor(clipped / step + 0.5) * step

    y, x = tf.meshgrid(within(size[0]), within(size[1]), indexing="ij")
    score = _coverage(votes.agreement, x, y, half)
    score = tf.where(score > 0.3 * tf.reduce_max(score), score, 0.0)
    flat_x, flat_y, flat = (tf.reshape(t, [-1]) for t in (x, y, score))
    flat_xy = tf.stack([flat_x, flat_y], 1)

    def choose(
        turn: tf.Tensor, nearest: tf.Tensor, chosen: tf.Tensor
    ) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        best = tf.argmax(flat * nearest, output_type=tf.int32)
        here, covered = tf.gather(flat_xy, best), tf.gather(flat, best)
        weight = tf.where((tf.gather(nearest, best) > params.apart_share) & (covered > 0), covered, 0.0)
        row = tf.concat([here, weight[None]], 0)
        distance = tf.sqrt(tf.reduce_sum((flat_xy - here) ** 2, 1)) / (2 * half)
        return turn + 1, tf.minimum(nearest, distance), chosen + tf.one_hot(turn, count)[:, None] * row

    start = (tf.constant(0), tf.fill([FRAME_CELLS**2], 1e3), tf.zeros([count, 3]))
    _, _, chosen = tf.while_loop(lambda turn, *_: turn < count, choose, start, maximum_iterations=count)
    return chosen[:, :2], chosen[:, 2]


def _coverage(agreement: tf.Tensor, x: tf.Tensor, y: tf.Tensor, half: tf.Tensor) -> tf.Tensor:
    """Return the mean of `agreement` over the square of `half` side (frame pixels) around every (x, y)."""
    total = tf.pad(tf.cumsum(tf.cumsum(agreement, 0), 1), [[1, 0], [1, 0]])

    def corner(at_x: tf.Tensor, at_y: tf.Tensor) -> tf.Tensor:
        column, row = (
            tf.cast(tf.clip_by_value(tf.round(t / CELL_PX), 0.0, FRAME_CELLS), tf.int32) for t in (at_x, at_y)
        )
        return tf.gather(tf.reshape(total, [-1]), row * (FRAME_CELLS + 1) + column)

    inside = (
        corner(x + half, y + half)
        - corner(x - half, y + half)
        - corner(x + half, y - half)
        + corner(x - half, y - half)
    )
    return inside * (CELL_PX / (2 * half)) ** 2
