"""All inpainters by name. A new one is a file with its settings, which load it, and an entry here."""

from laesi_tf.inpainting.base import InpainterSettings
from laesi_tf.inpainting.controlnet import ControlNetSettings
from laesi_tf.inpainting.exemplar import ExemplarSettings

INPAINTERS: dict[str, type[InpainterSettings]] = {
    "controlnet": ControlNetSettings,
    "exemplar": ExemplarSettings,
}
"""Values of `inpaint --model`."""
