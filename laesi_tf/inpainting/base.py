"""The protocol of all inpainters, what they are given and what they return.

An inpainter paints a new leaf into the mask of an image. What it paints elsewhere is dropped by
`restore_background`, since the label lives there: the printed lines give the scale.
"""

import abc
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.schema import check_fields


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskedImage:
    """An image whose leaf is to be repainted."""

    image: RgbImage
    """uint8 [H, W, 3]."""
    mask: Mask
    """bool [H, W], True on the leaf, not empty."""
    prompt: str
    """Text for an image generator, such as "oak leaf on millimeter paper"."""
    species: str | None
    """Species in the prompt; None where it is another text."""
    seed: int
    """Seed of this image alone, from 0 up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Repainting:
    """What an inpainter made of an image."""

    image: RgbImage
    """uint8 [H, W, 3]."""
    prompt: str
    """The prompt that was used."""
    imperfection: str = ""
    """Name of an imperfection that was painted on purpose; empty if there is none."""


class Inpainter(Protocol):
    """A way to repaint leaves."""

    @property
    def name(self) -> str:
        """Name of the model, which is stored with each image."""
        ...

    @property
    def strength(self) -> float:
        """Share of the leaf's appearance that is replaced, 0..1, which is stored with each image."""
        ...

    @property
    def batch_size(self) -> int:
        """Number of images to repaint at once."""
        ...

    def repaint(self, images: Sequence[MaskedImage]) -> list[Repainting]:
        """Repaint `images`, which have one size. The result of each depends on that image only."""
        ...


@dataclass(frozen=True, kw_only=True)
class InpainterSettings(abc.ABC):
    """Settings of an inpainter: fields declared by `laesi_tf.common.schema.option`, which are flags, too.

    Raises InputError for a value of the wrong type or out of range.
    """

    execution_fields: ClassVar[tuple[str, ...]] = ()
    """Fields that say how to compute rather than what: a data set may be continued with other ones."""

    def __post_init__(self) -> None:
        check_fields(self)

    @classmethod
    def field_names(cls) -> list[str]:
        """Return the names of the settings."""
        return [field.name for field in dataclasses.fields(cls)]

    @abc.abstractmethod
    def check(self) -> None:
        """Raise InputError for what is missing and can be seen at once, such as a folder or a package."""

    @abc.abstractmethod
    def load(self) -> Inpainter:
        """Load the inpainter. Raises InputError."""

    def describe(self) -> dict[str, Any]:
        """Return the settings that decide what is painted, for JSON."""
        values = dataclasses.asdict(self)
        return {name: value for name, value in values.items() if name not in self.execution_fields}


def image_seed(seed: int, scene_seed: int, index: int) -> int:
    """Return the seed of one image, below 2^63, of the seed of the command and the scene's seed and index."""
    state = np.random.SeedSequence([seed, scene_seed, index]).generate_state(1, np.uint64)
    return int(state[0] >> 1)


def restore_background(repainted: RgbImage, image: RgbImage, mask: Mask) -> RgbImage:
    """Return `repainted` inside `mask` [H, W] and `image` [H, W, 3] outside, pixel for pixel.

    Paper, section "Integration of ControlNet Inpainting": the millimetre paper of the generated image cannot
    be used, as the area would not fit it.
    """
    return np.where(mask[..., np.newaxis], repainted, image)
