"""Repaint leaves by a diffusion model that a ControlNet guides along the edges of their masks.

Paper, section "Integration of ControlNet Inpainting": the control picture is the Canny edges of the mask, the
region is the mask, the text names the species.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
from PIL import Image

from laesi_tf.common.arrays import Mask, RgbImage
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import option, read_toml
from laesi_tf.data.canny import detect_canny_edges
from laesi_tf.inpainting.base import InpainterSettings, MaskedImage, Repainting
from laesi_tf.inpainting.diffusion_models import (
    BASE_ID,
    CONTROLNET_ID,
    choose_device,
    load_pipeline,
    make_generator,
    require_model_name,
    require_packages,
)

_LATENT_PX = 8
"""The autoencoder of Stable Diffusion shrinks an image by this factor."""
_SPECIES = "{species}"


@dataclass(frozen=True, kw_only=True)
class ControlNetSettings(InpainterSettings):
    """Settings of the diffusion model."""

    controlnet: str = option(
        CONTROLNET_ID, "ControlNet for Canny edges: an id on Hugging Face, or a folder", metavar="ID|DIR"
    )
    base: str = option(
        BASE_ID, "inpainting model of the family Stable Diffusion 1.5: an id, or a folder", metavar="ID|DIR"
    )
    prompt: str = option(
        "", "prompt in which {species} stands for the species (default: the one stored with each image)"
    )
    prompts: str = option(
        "", 'TOML file with prompts for some species: oak = "brown oak leaf"', metavar="FILE"
    )
    steps: int = option(20, "steps of the diffusion", low=1, high=1000)
    guidance: float = option(7.5, "guidance scale: how closely the prompt is followed", low=0, high=100)
    conditioning_scale: float = option(1.0, "weight of the edges", low=0, high=10)
    strength: float = option(
        1.0, "share of the diffusion that is run; below 1 the synthetic leaf stays visible", low=0.01, high=1
    )
    size: int = option(
        512,
        "longer side of the images that the model paints, in pixels; it was trained at 512",
        low=64,
        high=4096,
    )
    batch: int = option(8, "images painted at once", low=1, high=1024)
    device: str = option("auto", "auto: the first available of cuda, mps and cpu", metavar="cuda|mps|cpu")
    precision: str = option("auto", "auto: half on a GPU, full on a CPU", choices=("auto", "half", "full"))

    execution_fields: ClassVar[tuple[str, ...]] = ("batch", "device", "precision", "prompts")

    def check(self) -> None:
        """Raise InputError if a package is missing or the prompts cannot be read."""
        require_packages()
        for flag, name in (("--controlnet", self.controlnet), ("--base", self.base)):
            require_model_name(name, flag)
        self.read_prompts()

    def describe(self) -> dict[str, Any]:
        """Return the settings that decide what is painted, with the content of the file of prompts."""
        return super().describe() | {"prompts": self.read_prompts()}

    def read_prompts(self) -> dict[str, str]:
        """Return the prompts of the file by species. Raises InputError."""
        prompts = read_toml(self.prompts, what="prompts") if self.prompts else {}
        for species, prompt in prompts.items():
            if not isinstance(prompt, str):
                raise InputError(f'{self.prompts}: {species} is {prompt!r}; write a text, {species} = "..."')
        return prompts

    def load(self) -> "ControlNetInpainter":
        """Load the networks. Raises InputError."""
        return ControlNetInpainter(self)


class ControlNetInpainter:
    """Paints with diffusers' StableDiffusionControlNetInpaintPipeline."""

    def __init__(self, settings: ControlNetSettings) -> None:
        """Load the networks. Raises InputError."""
        self._settings = settings
        self._prompts = settings.read_prompts()
        device = choose_device(settings.device)
        is_half = settings.precision == "half" or (settings.precision == "auto" and device != "cpu")
        self._pipeline = load_pipeline(settings.base, settings.controlnet, device=device, is_half=is_half)
        self.name = f"{settings.controlnet} + {settings.base}"
        self.strength = settings.strength
        self.batch_size = settings.batch

    def repaint(self, images: Sequence[MaskedImage]) -> list[Repainting]:
        """Paint leaves; see `Inpainter.repaint`.

        Each image has a random generator of its own. Batches of other sizes differ by rounding only.
        """
        height, width = images[0].mask.shape
        size = working_size((height, width), self._settings.size)
        masks = [_enlarge_mask(image.mask, size) for image in images]
        prompts = [self.write_prompt(image) for image in images]
        painted = self._pipeline(
            prompt=prompts,
            image=[Image.fromarray(_resize(image.image, size)) for image in images],
            mask_image=[Image.fromarray(mask.astype(np.uint8) * 255) for mask in masks],
            control_image=[Image.fromarray(_draw_control_image(mask)) for mask in masks],
            height=size[0],
            width=size[1],
            num_inference_steps=self._settings.steps,
            guidance_scale=self._settings.guidance,
            controlnet_conditioning_scale=self._settings.conditioning_scale,
            strength=self._settings.strength,
            generator=[make_generator(image.seed) for image in images],
            output_type="np",
        ).images
        pixels = np.rint(255 * np.clip(painted, 0, 1)).astype(np.uint8)
        return [
            Repainting(image=_resize(image, (height, width)), prompt=prompt)
            for image, prompt in zip(pixels, prompts, strict=True)
        ]

    def write_prompt(self, image: MaskedImage) -> str:
        """Return the prompt for `image`: of the file, else `--prompt`, else the stored one."""
        if self._prompts and image.species is not None and image.species in self._prompts:
            return self._prompts[image.species]
        if not self._settings.prompt:
            return image.prompt
        return self._settings.prompt.replace(_SPECIES, image.species or "")


def working_size(size: tuple[int, int], side: int) -> tuple[int, int]:
    """Return `size` (height, width) with a longer side of about `side`, in multiples of 8 pixels."""
    scale = side / max(size)
    height, width = (max(1, round(length * scale / _LATENT_PX)) * _LATENT_PX for length in size)
    return height, width


def _enlarge_mask(mask: Mask, size: tuple[int, int]) -> Mask:
    """Resize a mask [H, W] to `size`; its edge becomes smooth rather than a staircase."""
    return _resize(mask.astype(np.uint8) * 255, size) > 127


def _draw_control_image(mask: Mask) -> RgbImage:
    """Return the edges of `mask` [h, w] as an image [h, w, 3].

    They are found at the size that is painted: ControlNet was trained on edges one pixel wide.
    """
    return np.repeat(detect_canny_edges(mask.astype(np.uint8))[..., np.newaxis], 3, axis=-1)


def _resize(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resize an image [H, W, ...] to `size` (height, width)."""
    if image.shape[:2] == size:
        return image
    interpolation = cv2.INTER_AREA if image.shape[0] > size[0] else cv2.INTER_CUBIC
    return cv2.resize(image, size[::-1], interpolation=interpolation)
