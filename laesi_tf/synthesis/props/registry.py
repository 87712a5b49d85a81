"""The props by name, in the order in which they are drawn: from flat to high.

A prop is one file: its parameters, a subclass of PropParams with a field of the prop's name, and the function
that makes its shapes. It is registered here, in PROPS and in the bases of PropsParams, with two new streams.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import tensorflow as tf

from laesi_tf.synthesis.props.calibration_square import CalibrationParams, make_calibration_square
from laesi_tf.synthesis.props.clip import ClipParams, make_clip
from laesi_tf.synthesis.props.coin import CoinParams, make_coin
from laesi_tf.synthesis.props.cover import PaneParams, TapeParams, make_pane, make_tape
from laesi_tf.synthesis.props.finger import FingerParams, make_finger
from laesi_tf.synthesis.props.fragment import FragmentParams, make_fragment
from laesi_tf.synthesis.props.handwriting import HandwritingParams, make_handwriting
from laesi_tf.synthesis.props.label import LabelParams, make_label
from laesi_tf.synthesis.props.note import (
    BarcodeParams,
    NoteParams,
    ScribbleParams,
    make_barcode,
    make_note,
    make_scribble,
)
from laesi_tf.synthesis.props.pen import PenParams, make_pen
from laesi_tf.synthesis.props.pencil import PencilParams, make_pencil
from laesi_tf.synthesis.props.placement import SHAPE_NUMBERS, PropParams, PropShape
from laesi_tf.synthesis.props.ruler import RulerParams, make_ruler
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Range, Scalar, Value, field_count, largest_params, sample_params


@dataclasses.dataclass(frozen=True)
class Prop:
    """One kind of prop.

    `make(params, largest, context, numbers)` returns its shapes, the lowest first: `params` are sampled,
    `largest` the upper ends of their ranges, `numbers` [SHAPE_NUMBERS] uniform in [0, 1). The streams are
    those of the parameters and of the numbers.
    """

    params: type[PropParams[Any]]
    make: Callable[..., list[PropShape]]
    stream: Stream
    shape_stream: Stream
    covers_leaf: bool = False
    """It is clear and lies over the leaf; all others lie beside it."""


PROPS: dict[str, Prop] = {
    "handwriting": Prop(HandwritingParams, make_handwriting, Stream.HANDWRITING, Stream.HANDWRITING_SHAPE),
    "fragment": Prop(FragmentParams, make_fragment, Stream.FRAGMENT, Stream.FRAGMENT_SHAPE),
    "label": Prop(LabelParams, make_label, Stream.LABEL, Stream.LABEL_SHAPE),
    "coin": Prop(CoinParams, make_coin, Stream.COIN, Stream.COIN_SHAPE),
    "pen": Prop(PenParams, make_pen, Stream.PEN, Stream.PEN_SHAPE),
    "scribble": Prop(ScribbleParams, make_scribble, Stream.SCRIBBLE, Stream.SCRIBBLE_SHAPE),
    "note": Prop(NoteParams, make_note, Stream.NOTE, Stream.NOTE_SHAPE),
    "barcode": Prop(BarcodeParams, make_barcode, Stream.BARCODE, Stream.BARCODE_SHAPE),
    "clip": Prop(ClipParams, make_clip, Stream.CLIP, Stream.CLIP_SHAPE),
    "ruler": Prop(RulerParams, make_ruler, Stream.RULER, Stream.RULER_SHAPE),
    "pencil": Prop(PencilParams, make_pencil, Stream.PENCIL, Stream.PENCIL_SHAPE),
    "finger": Prop(FingerParams, make_finger, Stream.FINGER, Stream.FINGER_SHAPE),
    # Last of what lies beside the leaf, since nothing may hide it.
    "calibration": Prop(
        CalibrationParams, make_calibration_square, Stream.CALIBRATION, Stream.CALIBRATION_SHAPE
    ),
    "tape": Prop(TapeParams, make_tape, Stream.TAPE, Stream.TAPE_SHAPE, covers_leaf=True),
    "pane": Prop(PaneParams, make_pane, Stream.PANE, Stream.PANE_SHAPE, covers_leaf=True),
}


@dataclasses.dataclass(frozen=True)
class PropsParams(
    PaneParams[Value],
    TapeParams[Value],
    FingerParams[Value],
    PencilParams[Value],
    RulerParams[Value],
    ClipParams[Value],
    BarcodeParams[Value],
    NoteParams[Value],
    ScribbleParams[Value],
    CalibrationParams[Value],
    PenParams[Value],
    CoinParams[Value],
    LabelParams[Value],
    FragmentParams[Value],
    HandwritingParams[Value],
):
    """The parameters of all props: table [props] of a ranges file."""


class SampledProp(NamedTuple):
    """One prop of a scene.

    Its parameters, the upper ends of their ranges, and the uniform numbers [SHAPE_NUMBERS] of its shape.
    """

    name: str
    params: PropParams[Scalar]
    largest: PropParams[float]
    numbers: tf.Tensor

    @property
    def is_present(self) -> tf.Tensor:
        """Whether the scene has it: bool []."""
        return getattr(self.params, self.name)


def sample_prop(name: str, ranges: PropsParams[Range], streams: RandomStreams) -> SampledProp:
    """Sample prop `name` from its own streams."""
    prop, own = PROPS[name], prop_ranges(name, ranges)
    return SampledProp(
        name=name,
        params=sample_params(own, streams.uniform([field_count(own)], prop.stream)),
        largest=largest_params(own),
        numbers=streams.uniform([SHAPE_NUMBERS], prop.shape_stream),
    )


def prop_ranges(name: str, ranges: PropsParams[Range]) -> PropParams[Range]:
    """Return the ranges of prop `name` only."""
    fields = dataclasses.fields(PROPS[name].params)
    return PROPS[name].params(**{field.name: getattr(ranges, field.name) for field in fields})
