"""Parameters of the stages of a measurement, each with its unit and the data that it was set on.

A stage keeps its parameters in one frozen dataclass whose fields are made by `parameter`; a field may be the
parameters of a stage within it. `python -m laesi_tf.benchmark sensitivity` measures what each is worth.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

SCENES = "scenes of rendering_2 and semi-real photos, by hand, 2026-11-25"
"""Data and time at which most parameters were set."""
RENDERED = "rendered (split develop) and every ninth photo of semireal's train, 2026-11-28"
"""The same for parameters of the reader of rulings."""
RENDERED_AND_CASES = "rendered (split develop), cases and every ninth photo of semireal's train, 2026-11-28"
"""The same for those that decide which lines are printed and what is refused."""


class Parameter(NamedTuple):
    """One parameter of a stage."""

    name: str
    """Dotted path from the outermost stage, such as `detector.min_fill`."""
    value: Any
    unit: str
    set_on: str


def parameter(default: Any, *, unit: str, set_on: str = SCENES) -> Any:
    """Return a dataclass field with a default, its `unit` and the data and date it was `set_on`."""
    return dataclasses.field(default=default, metadata={"unit": unit, "set_on": set_on})


def list_parameters(params: Any, prefix: str = "") -> Iterator[Parameter]:
    """Yield the parameters of a stage and of the stages within it, in the order of their fields."""
    for field in dataclasses.fields(params):
        value = getattr(params, field.name)
        if dataclasses.is_dataclass(value):
            yield from list_parameters(value, f"{prefix}{field.name}.")
        else:
            yield Parameter(f"{prefix}{field.name}", value, field.metadata["unit"], field.metadata["set_on"])


def replace_parameter(params: Any, name: str, value: Any) -> Any:
    """Return `params` with the parameter `name` set to `value`. Raises KeyError for an unknown name."""
    head, _, rest = name.partition(".")
    if head not in {field.name for field in dataclasses.fields(params)}:
        raise KeyError(name)
    return dataclasses.replace(
        params, **{head: replace_parameter(getattr(params, head), rest, value) if rest else value}
    )
