"""Condition an image generator on a leaf mask: Canny edges and a text prompt."""

import cv2
import numpy as np


def species_prompt(species: str) -> str:
    """What the paper asks ControlNet for (section "Integration of ControlNet Inpainting")."""
    return f"{species} leaf on millimeter paper"


def detect_canny_edges(mask: np.ndarray) -> np.ndarray:
    """Canny edges uint8 [H, W] 0/255 of a mask [H, W] 0/1: what ControlNet is conditioned on."""
    return cv2.Canny(mask * 255, 100, 200)
