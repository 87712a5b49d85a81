"""Condition an image generator on a leaf: Canny edges of its mask and a text prompt."""

import cv2
import numpy as np
from numpy.typing import NDArray

_PROMPT_END = " leaf on millimeter paper"


def detect_canny_edges(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the Canny edges, uint8 [H, W] 0/255, of a mask uint8 [H, W] 0/1: the input of ControlNet."""
    return cv2.Canny(mask * 255, 100, 200)


def prompt_species(prompt: str) -> str | None:
    """Return the species of a prompt that `species_prompt` made; None for any other."""
    species = prompt.removesuffix(_PROMPT_END)
    return species if species and species != prompt else None


def species_prompt(species: str) -> str:
    """Return the paper's prompt (section "Integration of ControlNet Inpainting")."""
    return f"{species}{_PROMPT_END}"
