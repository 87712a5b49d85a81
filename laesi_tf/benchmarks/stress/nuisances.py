"""The nuisances, from none to absurd. A further one is a further entry of NUISANCES."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from laesi_tf.benchmarks.stress import photo_filters
from laesi_tf.benchmarks.stress.calm_scenes import CALM, LEAF_MM, VIEW_MM, Numbers
from laesi_tf.benchmarks.stress.stress_photo import StressPhoto
from laesi_tf.synthesis.paper.params import KIND_NAMES

Filter = Callable[[StressPhoto, float, photo_filters.Rng], StressPhoto]


@dataclass(frozen=True, kw_only=True)
class Nuisance:
    """One nuisance: its severities, and what makes a scene or any picture so severe."""

    name: str
    unit: str
    severities: tuple[float, ...]
    """The first is none: the picture as it is."""
    labels: tuple[str, ...] = ()
    """What severities are called that are no quantities."""
    of_scene: Callable[[float], Numbers] | None = None
    """Numbers of the scene; without them, `of_photo` is applied to scenes, too."""
    of_photo: Filter | None = None
    """Without it, photographs are left out."""

    @property
    def digest(self) -> str:
        """What changes with its severities."""
        return f"{self.severities} {self.labels}"

    def label(self, step: int) -> str:
        """Return what severity number `step` is called."""
        return self.labels[step] if self.labels else f"{self.severities[step]:g}"


_PROPS_BY_SIZE = ("coin", "label", "pen", "note", "pencil", "barcode", "clip", "ruler", "fragment", "finger")
_FAMILIES: tuple[tuple[str, Numbers], ...] = (
    ("all", {}),
    ("no 10 mm", {"paper.has_10mm": 0}),
    ("no 5 mm", {"paper.has_5mm": 0}),
    ("only 1 mm", {"paper.has_5mm": 0, "paper.has_10mm": 0}),
    ("1 mm faint", {"paper.strength_1mm": 0.12}),
    ("1 mm drowned", {"paper.strength_1mm": 0.02}),
    ("one way faint", {"paper.balance": 0.2}),
)


def _ruling_strength(share: float) -> Numbers:
    names = ("paper.strength_1mm", "paper.strength_5mm", "paper.strength_10mm")
    return {name: share * CALM[name] for name in names}


def _margins(margin_mm: float) -> Numbers:
    sides = dict.fromkeys(("paper.left", "paper.right", "paper.top", "paper.bottom"), margin_mm)
    return {"paper.edged": 1, **sides}


def _view(width_mm: float) -> Numbers:
    length = min(LEAF_MM, 0.6 * width_mm)
    return {"camera.closest_mm": width_mm, "camera.farthest_mm": width_mm, "leaf.length_mm": length}


def _strokes(width_mm: float) -> Numbers:
    present = {"handwriting.handwriting": 1.0, "scribble.scribble": 1.0} if width_mm else {}
    return {**present, "handwriting.stroke_mm": width_mm, "scribble.stroke_mm": width_mm}


NUISANCES = (
    Nuisance(
        name="tilt",
        unit="degrees",
        severities=(0, 10, 20, 30, 40, 50, 60),
        of_scene=lambda angle: {"camera.tilted": 1, "camera.tilt_deg": angle},
        of_photo=photo_filters.tilt_photo,
    ),
    Nuisance(
        name="roll",
        unit="degrees",
        severities=(0, 5, 15, 30, 45),
        of_scene=lambda angle: {"camera.roll": math.radians(angle)},
    ),
    Nuisance(
        name="lens distortion",
        unit="k1",
        severities=(0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3),
        of_scene=lambda k1: {"camera.distorted": 1, "camera.k1": k1},
        of_photo=photo_filters.distort_photo,
    ),
    Nuisance(
        name="bent sheet",
        unit="height at the side, camera distances",
        severities=(0, 0.01, 0.02, 0.04, 0.07, 0.1),
        of_scene=lambda bend: {"camera.bent": 1, "camera.bend": bend},
    ),
    Nuisance(
        name="wide view",
        unit="mm",
        severities=(VIEW_MM, 200, 300, 400, 500, 600, 900),
        of_scene=_view,
    ),
    Nuisance(name="close view", unit="mm", severities=(VIEW_MM, 100, 60, 40, 30, 20), of_scene=_view),
    Nuisance(
        name="fewer pixels",
        unit="share of the sides",
        severities=(1, 0.7, 0.5, 0.35, 0.25, 0.15),
        of_photo=photo_filters.shrink_photo,
    ),
    Nuisance(
        name="focus blur",
        unit="pixels",
        severities=(0, 0.7, 1.5, 2.5, 4, 7),
        of_photo=photo_filters.blur_focus,
    ),
    Nuisance(
        name="motion blur",
        unit="pixels",
        severities=(0, 3, 6, 10, 16, 30),
        of_photo=photo_filters.blur_motion,
    ),
    Nuisance(
        name="noise",
        unit="levels of 255",
        severities=(0, 5, 12, 25, 50, 90),
        of_photo=photo_filters.add_noise,
    ),
    Nuisance(
        name="JPEG",
        unit="quality",
        severities=(100, 85, 60, 40, 20, 10, 4),
        of_photo=photo_filters.compress_jpeg,
    ),
    Nuisance(
        name="too dark",
        unit="share of the light",
        severities=(1, 0.5, 0.25, 0.1, 0.04, 0.015),
        of_photo=photo_filters.expose,
    ),
    Nuisance(
        name="too bright",
        unit="times the light",
        severities=(1, 1.2, 1.5, 2, 3, 5),
        of_photo=photo_filters.expose,
    ),
    Nuisance(
        name="shadow",
        unit="share of the light",
        severities=(0, 0.3, 0.5, 0.7, 0.85, 0.97),
        of_scene=lambda strength: {"light.strength": strength, "light.offset_mm": 3},
    ),
    Nuisance(
        name="glare",
        unit="share of white",
        severities=(0, 0.2, 0.4, 0.6, 0.8, 1),
        of_scene=lambda strength: {"light.glare": 1, "light.glare_strength": strength},
    ),
    Nuisance(
        name="faint ruling",
        unit="share of its contrast",
        severities=(1, 0.5, 0.25, 0.12, 0.06, 0.03, 0),
        of_scene=_ruling_strength,
        of_photo=lambda photo, share, rng: photo_filters.fade_ruling(photo, 1 - share, rng),
    ),
    Nuisance(
        name="line families",
        unit="",
        severities=tuple(range(len(_FAMILIES))),
        labels=tuple(name for name, _ in _FAMILIES),
        of_scene=lambda step: _FAMILIES[int(step)][1],
    ),
    Nuisance(
        name="other rulings",
        unit="",
        severities=tuple(range(len(KIND_NAMES))),
        labels=KIND_NAMES,
        of_scene=lambda step: {"paper.kind": step},
    ),
    Nuisance(
        name="small sheet",
        unit="mm around the leaf",
        severities=(60, 30, 15, 8, 4, 1),
        of_scene=_margins,
        of_photo=photo_filters.cut_sheet,
    ),
    Nuisance(
        name="clutter",
        unit="things",
        severities=(0, 1, 2, 4, 6, 10),
        of_scene=lambda count: {f"{name}.{name}": 1 for name in _PROPS_BY_SIZE[: int(count)]},
    ),
    Nuisance(
        name="handwriting", unit="mm of stroke", severities=(0, 0.4, 0.8, 1.5, 2.5, 4), of_scene=_strokes
    ),
    Nuisance(
        name="covered leaf",
        unit="share",
        severities=(0, 0.05, 0.1, 0.2, 0.35, 0.5),
        of_photo=photo_filters.cover_leaf,
    ),
    Nuisance(
        name="small leaf",
        unit="mm",
        severities=(LEAF_MM, 40, 25, 15, 8, 4),
        of_scene=lambda length: {"leaf.length_mm": length},
    ),
    Nuisance(
        name="narrow leaf",
        unit="width over length",
        severities=(0.5, 0.3, 0.15, 0.08, 0.04, 0.02),
        of_scene=lambda aspect: {"leaf.aspect": aspect},
    ),
    Nuisance(
        name="holes",
        unit="radius over length",
        severities=(0, 0.01, 0.02, 0.04, 0.07, 0.1),
        of_scene=lambda radius: {"leaf.holed": 1, "leaf.hole_radius": radius},
    ),
    Nuisance(
        name="leaf as pale as paper",
        unit="share of paper's colour",
        severities=(0, 0.3, 0.5, 0.7, 0.85, 0.95),
        of_photo=photo_filters.bleach_leaf,
    ),
)
