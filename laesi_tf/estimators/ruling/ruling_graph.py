"""The stages of reading a ruling, from pixels to a verdict, as TensorFlow functions with their network.

`sheet_reader` calls them one after the other: on photos directly, or in the LiteRT file that `exporting`
converts from them. Within a graph of a whole photo they are one function, `read_frame`.
"""

import copy
from collections.abc import Callable, Sequence
from typing import Any

import keras
import numpy as np
import tensorflow as tf

from laesi_tf.estimators.ruling.params import RulingReaderParams
from laesi_tf.estimators.ruling.reading import Reading, read_sheet
from laesi_tf.estimators.ruling.resolution import needs_full_resolution, no_answers
from laesi_tf.estimators.ruling.spectra import Pyramid, build_pyramid, join_levels
from laesi_tf.estimators.ruling.stage import compile_stage
from laesi_tf.estimators.ruling.verdict import state_verdict
from laesi_tf.estimators.ruling.votes import Votes, collect_votes
from laesi_tf.models.ruling_cells import CELL_PX, FRAME_CELLS, FRAME_PX, LEVELS, CellAnswers
from laesi_tf.models.ruling_network import build_ruling_network, to_answers

_SMALL_PX = FRAME_PX // 2
"""Photos up to this size take a quarter of the network's time."""


class RulingGraph(tf.Module):
    """Reads rulings with a trained network; its methods are those of `sheet_reader.RulingStages`."""

    def __init__(self, network: keras.Model, params: RulingReaderParams | None = None) -> None:
        """Take a ruling network of any input size, [B, h, w, 3] -> logits."""
        super().__init__(name="ruling_graph")
        self.params = params or RulingReaderParams()
        self._keras_network = build_ruling_network()
        self._keras_network.set_weights(network.get_weights())
        self._network: Callable[..., Any] = self._keras_network
        self._run_network = compile_stage(self._infer)

    def with_params(self, params: RulingReaderParams) -> "RulingGraph":
        """Return a graph with the same network and other parameters."""
        changed = copy.copy(self)
        changed.params = params
        return changed

    def with_network(self, change: Callable[[keras.Model], Callable[..., Any]]) -> "RulingGraph":
        """Return a graph whose network is replaced by what `change` makes of it, as for an export."""
        changed = copy.copy(self)
        changed._network = change(self._keras_network)
        changed._run_network = compile_stage(changed._infer)
        return changed

    def ask_network(self, images: tf.Tensor) -> tf.Tensor:
        """Return the logits [B, h / CELL_PX, w / CELL_PX, CHANNELS] for images, float32 [B, h, w, 3]."""
        return self._run_network(tf.convert_to_tensor(images))

    def needs_full_resolution(self, coarse: Sequence[tf.Tensor], size: tf.Tensor) -> tf.Tensor:
        """Return whether the coarse levels do not suffice, bool scalar.

        `coarse` are the logits of all levels but the first, each [FRAME_CELLS >> level] * 2 + [CHANNELS];
        `size` [2] is the photo's (height, width) in frame pixels, float32.
        """
        answers = [_interpret(logits, size, level) for level, logits in enumerate(coarse, 1)]
        return self._needs_full(answers, collect_votes([no_answers(), *answers], params=self._votes))

    def read(
        self,
        frame: tf.Tensor,
        coarser: tf.Tensor,
        logits: Sequence[tf.Tensor],
        size: tf.Tensor,
        is_full: tf.Tensor,
        grid_mm: tf.Tensor,
    ) -> dict[str, tf.Tensor]:
        """Return what the lines say, and whether that is believed, see `verdict.state_verdict`.

        `frame` and `coarser` are those of `spectra.Pyramid`, `logits` those of all its levels; those of the
        first count where `is_full`. `grid_mm` is the distance of the finest lines where the user names it,
        else 0.
        """
        size, grid_mm = (tf.convert_to_tensor(value, tf.float32) for value in (size, grid_mm))
        full, *coarse = (_interpret(part, size, level) for level, part in enumerate(logits))
        full = full._replace(readable=tf.where(is_full, full.readable, 0.0))
        votes = collect_votes([full, *coarse], params=self._votes)
        pyramid = Pyramid(tf.convert_to_tensor(frame), tf.convert_to_tensor(coarser))
        reading = read_sheet(pyramid, size, votes, params=self.params.reading)
        return state_verdict(reading, size, grid_mm, params=self.params.judge)

    def read_frame(self, frame: tf.Tensor, size: tf.Tensor) -> Reading:
        """Read the ruling of the photo of `size` [2] (height, width), float, in the upper left corner of a
        frame, uint8 [FRAME_PX, FRAME_PX, 3], within one graph."""
        levels = build_pyramid(tf.cast(frame, tf.float32), LEVELS)[1:]
        # The network sees no more of the frame than `SheetReader` shows it, as far as a few sizes allow.
        votes = tf.cond(
            tf.reduce_max(size) <= _SMALL_PX,
            lambda: self._ask_levels(frame, levels, size, _SMALL_PX),
            lambda: self._ask_levels(frame, levels, size, FRAME_PX),
        )
        return read_sheet(join_levels([frame, *levels]), size, votes, params=self.params.reading)

    def _ask_levels(self, frame: tf.Tensor, levels: list[tf.Tensor], size: tf.Tensor, used_px: int) -> Votes:
        """Return the votes of a frame and its coarser `levels`, of which the network sees a corner of
        `used_px` frame pixels."""

        def ask(level: int, image: tf.Tensor) -> CellAnswers:
            side = used_px >> level
            logits = self._run_network(image[tf.newaxis, :side, :side])[0]
            missing = (FRAME_CELLS >> level) - side // CELL_PX
            return _interpret(tf.pad(logits, [[0, missing], [0, missing], [0, 0]]), size, level)

        coarse = [ask(level, image) for level, image in enumerate(levels, 1)]
        votes = collect_votes([no_answers(), *coarse], params=self._votes)
        return tf.cond(
            self._needs_full(coarse, votes),
            lambda: collect_votes([ask(0, tf.cast(frame, tf.float32)), *coarse], params=self._votes),
            lambda: votes,
        )

    @property
    def _votes(self) -> Any:
        return self.params.reading.votes

    def _needs_full(self, coarse: list[CellAnswers], votes: Any) -> tf.Tensor:
        return needs_full_resolution(coarse, votes, self.params.resolution, sure=self._votes.sure)

    def _infer(self, images: tf.Tensor) -> tf.Tensor:
        return self._network(images, training=False)


def _interpret(logits: tf.Tensor, size: tf.Tensor, level: int) -> CellAnswers:
    """Return the answers of a whole level of the frame; cells beyond the photo of `size` are not readable."""
    answers = to_answers(tf.convert_to_tensor(logits))
    middles = (np.arange(FRAME_CELLS >> level, dtype=np.float32) + 0.5) * CELL_PX
    inside = (middles < size[0] / 2.0**level)[:, None] & (middles < size[1] / 2.0**level)
    return answers._replace(readable=tf.where(inside, answers.readable, 0.0))
