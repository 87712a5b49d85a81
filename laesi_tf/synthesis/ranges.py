"""Parameters of a scene and the ranges from which they are sampled.

Each part of a scene (paper, leaf, light, ...) declares its parameters once, as a frozen dataclass that is
generic over what its fields hold. `PaperParams[Range]` holds ranges, its defaults are preset `rendering_2`;
`sample_params` makes of it a `PaperParams[Scalar]`, which holds one number per field. A range is one of

- `(low, high)`: uniform between the two;
- `Probability(p)`: True with probability p;
- `Choice(names, weights)`: one of some names, as often as its weight says;
- a plain number: always that number.

Fields are append-only: field i is sampled from number i of its part's random stream, so a new field at the
end leaves the others as they were.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np
import tensorflow as tf


class Probability(NamedTuple):
    """True with probability `p`."""

    p: float


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of `names`, sampled in proportion to `weights`; the sampled field holds its position."""

    names: tuple[str, ...]
    weights: tuple[float, ...]

    def with_weights(self, **weights: float) -> "Choice":
        """Return a choice between the same names with these weights, 0 for the names not given."""
        return Choice(self.names, tuple(weights.get(name, 0.0) for name in self.names))


Range: TypeAlias = float | tuple[float, float] | Probability | Choice
"""What a field holds before sampling."""


class Scalar(Protocol):
    """What a field holds after sampling: a scalar tensor, bool for a Probability, float32 otherwise.

    That of a Choice is the position of the chosen name.
    """

    def __add__(self, other: Any, /) -> Any: ...
    def __radd__(self, other: Any, /) -> Any: ...
    def __sub__(self, other: Any, /) -> Any: ...
    def __rsub__(self, other: Any, /) -> Any: ...
    def __mul__(self, other: Any, /) -> Any: ...
    def __rmul__(self, other: Any, /) -> Any: ...
    def __truediv__(self, other: Any, /) -> Any: ...
    def __rtruediv__(self, other: Any, /) -> Any: ...
    def __pow__(self, other: Any, /) -> Any: ...
    def __neg__(self) -> Any: ...
    def __gt__(self, other: Any, /) -> Any: ...
    def __and__(self, other: Any, /) -> Any: ...
    def __or__(self, other: Any, /) -> Any: ...
    def __invert__(self) -> Any: ...


Value = TypeVar("Value")
"""What the fields of a parameter class hold: `Range` or `Scalar`."""


def interval(low: float, high: float) -> Any:
    """Return the default of a field that is uniform between `low` and `high`.

    Any, as in the functions below: no static type is both Range and Value.
    """
    return low, high


def probability(p: float) -> Any:
    """Return the default of a field that is True with probability `p`."""
    return Probability(p)


def choice(*names: str) -> Any:
    """Return the default of a field that is always the first of `names` and may be any of them."""
    return Choice(names, (1.0,) + (0.0,) * (len(names) - 1))


def constant(value: float) -> Any:
    """Return the default of a field that is always `value`."""
    return value


def fields_of(params: Any) -> dict[str, Any]:
    """Return the fields of a parameter dataclass as a dict, in order of declaration."""
    return {field.name: getattr(params, field.name) for field in dataclasses.fields(params)}


def field_count(params: Any) -> int:
    """Return how many uniform numbers `sample_params` takes for `params`."""
    return len(dataclasses.fields(params))


def sample_params(ranges: Any, uniform: tf.Tensor) -> Any:
    """Sample every field of `ranges` from its range.

    `uniform` [field_count(ranges)] holds numbers in [0, 1). Returns the same dataclass with a scalar tensor
    in each field: bool for a Probability, float32 otherwise.
    """
    return sample_params_of_kind([ranges], tf.constant(0), uniform)


def sample_params_of_kind(kinds: Sequence[Any], kind: tf.Tensor, uniform: tf.Tensor) -> Any:
    """Sample every field of `kinds[kind]`, as `sample_params` does; all kinds are of one class."""
    bounds = np.array(
        [[_interval(value) for value in fields_of(ranges).values()] for ranges in kinds], np.float32
    )
    low, high = tf.unstack(tf.gather(tf.constant(bounds), kind), axis=-1)
    values = tf.unstack(low + uniform * (high - low))
    sampled = {
        name: _finish_value(range_, value)
        for (name, range_), value in zip(fields_of(kinds[0]).items(), values, strict=True)
    }
    return dataclasses.replace(kinds[0], **sampled)


def _finish_value(range_: Range, value: tf.Tensor) -> tf.Tensor:
    """Return the sampled field from a `value` that is uniform within its `_interval`."""
    if isinstance(range_, Probability):
        return value >= 0
    if isinstance(range_, Choice):
        return tf.cast(choose(range_.weights, value), tf.float32)
    return value


def choose(weights: Sequence[float], uniform: tf.Tensor) -> tf.Tensor:
    """Return the position, int32, of the interval of cumulative `weights` that holds `uniform` in [0, 1)."""
    steps = tf.cumsum(tf.constant(weights, tf.float32) / sum(weights))
    return tf.minimum(tf.reduce_sum(tf.cast(uniform >= steps, tf.int32)), len(weights) - 1)


def _interval(range_: Range) -> tuple[float, float]:
    """Return (low, high); a Probability p becomes an interval that is not below zero with probability p.

    A Choice becomes the interval from 0 to 1, for its cumulative weights.
    """
    if isinstance(range_, Choice):
        return 0.0, 1.0
    if isinstance(range_, Probability):
        return range_.p - 1, range_.p
    return range_ if isinstance(range_, tuple) else (range_, range_)


def largest_params(ranges: Any) -> Any:
    """Return the same dataclass with the upper end of its range in each field, a float."""
    return dataclasses.replace(
        ranges, **{name: float(_interval(range_)[1]) for name, range_ in fields_of(ranges).items()}
    )


def smallest(range_: Range) -> float:
    """Return the lower end of a range."""
    return float(_interval(range_)[0])
