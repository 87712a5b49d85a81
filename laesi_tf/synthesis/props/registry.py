"""The props by name, in the order in which they are drawn: from flat to high."""

import dataclasses
from collections.abc import Callable
from typing import Any

import tensorflow as tf

from laesi_tf.synthesis.props.calibration_square import CalibrationParams, make_calibration_square
from laesi_tf.synthesis.props.coin import CoinParams, make_coin
from laesi_tf.synthesis.props.fragment import FragmentParams, make_fragment
from laesi_tf.synthesis.props.handwriting import HandwritingParams, make_handwriting
from laesi_tf.synthesis.props.label import LabelParams, make_label
from laesi_tf.synthesis.props.pen import PenParams, make_pen
from laesi_tf.synthesis.props.placement import PropParams, PropShape
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Range, Scalar, Value, field_count, fields_of, sample_params


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


PROPS: dict[str, Prop] = {
    "handwriting": Prop(HandwritingParams, make_handwriting, Stream.HANDWRITING, Stream.HANDWRITING_SHAPE),
    "fragment": Prop(FragmentParams, make_fragment, Stream.FRAGMENT, Stream.FRAGMENT_SHAPE),
    "label": Prop(LabelParams, make_label, Stream.LABEL, Stream.LABEL_SHAPE),
    "coin": Prop(CoinParams, make_coin, Stream.COIN, Stream.COIN_SHAPE),
    "pen": Prop(PenParams, make_pen, Stream.PEN, Stream.PEN_SHAPE),
    # Last, since nothing may hide it.
    "calibration": Prop(
        CalibrationParams, make_calibration_square, Stream.CALIBRATION, Stream.CALIBRATION_SHAPE
    ),
}


@dataclasses.dataclass(frozen=True)
class PropsParams(
    CalibrationParams[Value],
    PenParams[Value],
    CoinParams[Value],
    LabelParams[Value],
    FragmentParams[Value],
    HandwritingParams[Value],
):
    """The parameters of all props: table [props] of a ranges file."""


def prop_ranges(name: str, ranges: PropsParams[Range]) -> PropParams[Range]:
    """Return the ranges of prop `name` only."""
    fields = dataclasses.fields(PROPS[name].params)
    return PROPS[name].params(**{field.name: getattr(ranges, field.name) for field in fields})


def sample_prop(name: str, ranges: PropsParams[Range], streams: RandomStreams) -> PropParams[Scalar]:
    """Sample the parameters of prop `name` from its own stream."""
    own = prop_ranges(name, ranges)
    sampled: PropParams[Scalar] = sample_params(own, streams.uniform([field_count(own)], PROPS[name].stream))
    return sampled


def is_present(name: str, params: PropParams[Scalar]) -> tf.Tensor:
    """Return whether the scene has prop `name`: bool []."""
    return fields_of(params)[name]
