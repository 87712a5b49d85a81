"""The props by name, in the order in which they are drawn."""

from collections.abc import Callable

import tensorflow as tf

from laesi_tf.synthesis.props.calibration_square import make_calibration_square
from laesi_tf.synthesis.props.coin import make_coin
from laesi_tf.synthesis.props.fragment import make_fragment
from laesi_tf.synthesis.props.handwriting import make_handwriting
from laesi_tf.synthesis.props.label import make_label
from laesi_tf.synthesis.props.params import PropsParams
from laesi_tf.synthesis.props.pen import make_pen
from laesi_tf.synthesis.props.placement import PropContext, PropShape
from laesi_tf.synthesis.random_streams import RandomStreams, Stream
from laesi_tf.synthesis.ranges import Scalar

PROPS: dict[str, Callable[[PropsParams[Scalar], PropContext, tf.Tensor], list[PropShape]]] = {
    "handwriting": make_handwriting,
    "fragment": make_fragment,
    "label": make_label,
    "coin": make_coin,
    "pen": make_pen,
    "calibration": make_calibration_square,
}


def sample_prop_numbers(streams: RandomStreams) -> tf.Tensor:
    """Sample the uniform numbers [prop, 80] behind the shapes of the props."""
    return streams.uniform([len(PROPS), 80], Stream.PROPS)
