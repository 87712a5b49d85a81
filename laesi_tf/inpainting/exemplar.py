"""Exemplar repainting: the texture of a photographed leaf is warped onto the synthetic one.

It needs no network weights and learns nothing: it stands in for a diffusion model where there is none. The
texture is aligned along the midlines of both leaves. Of a dozen photographed leaves the one of the most
similar shape is taken, and gaps are filled from its own colours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import option
from laesi_tf.inpainting.base import InpainterSettings, MaskedImage, Repainting
from laesi_tf.inpainting.donor_leaves import Donor, find_donor_photos, load_donors
from laesi_tf.inpainting.imperfections import IMPERFECTIONS, Canvas
from laesi_tf.inpainting.leaf_frame import fit_leaf_frame
from laesi_tf.inpainting.texture_warp import align_best

NAME = "exemplar"


@dataclass(frozen=True, kw_only=True)
class ExemplarSettings(InpainterSettings):
    """Settings of exemplar repainting."""

    textures: str = option("", "folder of photos with a manifest.csv that has a column mask", metavar="DIR")
    textures_split: str = option("", "split of that manifest (default: all photos)", metavar="NAME")
    donors: int = option(12, "photographed leaves that are compared for each image", low=1, high=1000)
    imperfect: float = option(
        0.2, "share of images with a deliberate imperfection: drift, holes, another leaf", low=0, high=1
    )

    def check(self) -> None:
        """Raise InputError if there is no photo with a mask."""
        if not self.textures:
            raise InputError("--model exemplar needs --textures DIR: a folder of photos with their masks")
        find_donor_photos(Path(self.textures), split=self.textures_split or None)

    def load(self) -> "ExemplarInpainter":
        """Load the leaves of the photos. Raises InputError."""
        donors = load_donors(Path(self.textures), split=self.textures_split or None)
        return ExemplarInpainter(donors, compared=self.donors, imperfect=self.imperfect)


class ExemplarInpainter:
    """Paints with textures of photographed leaves."""

    name = NAME
    strength = 1.0
    """Nothing of the synthetic leaf remains."""
    batch_size = 32

    def __init__(self, donors: Sequence[Donor], *, compared: int = 12, imperfect: float = 0.0) -> None:
        """Take the leaves; `compared` of them are tried for each image, a share `imperfect` is spoilt."""
        self._donors = donors
        self._compared = min(compared, len(donors))
        self._imperfect = imperfect

    def repaint(self, images: Sequence[MaskedImage]) -> list[Repainting]:
        """Paint leaves; see `Inpainter.repaint`."""
        return [self._repaint(image) for image in images]

    def _repaint(self, image: MaskedImage) -> Repainting:
        random = np.random.default_rng(image.seed)
        chosen = random.choice(len(self._donors), self._compared, replace=False)
        frame = fit_leaf_frame(image.mask)
        canvas = Canvas(
            image=image.image,
            mask=image.mask,
            frame=frame,
            alignment=align_best(frame, [self._donors[number] for number in chosen]),
            neighbour=align_best(frame, [self._donors[int(random.integers(len(self._donors)))]]),
        )
        name = ""
        if random.random() < self._imperfect:
            name = str(random.choice(list(IMPERFECTIONS)))
        texture = IMPERFECTIONS[name](canvas, random) if name else canvas.paint(canvas.alignment)
        painted = np.rint(np.where(image.mask[..., None], texture, image.image)).astype(np.uint8)
        return Repainting(image=painted, prompt=image.prompt, imperfection=name)
