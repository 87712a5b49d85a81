"""The parameters of all stages of the reader of rulings."""

from dataclasses import dataclass, field

from laesi_tf.estimators.parameters import parameter
from laesi_tf.estimators.ruling.reading import ReadingParams
from laesi_tf.estimators.ruling.resolution import ResolutionParams
from laesi_tf.estimators.ruling.verdict import JudgeParams


@dataclass(frozen=True, kw_only=True)
class RulingReaderParams:
    """Parameters of the reader's stages, in the order in which they run."""

    resolution: ResolutionParams = field(default_factory=ResolutionParams)
    reading: ReadingParams = field(default_factory=ReadingParams)
    judge: JudgeParams = field(default_factory=JudgeParams)
    sheet_agreement: float = parameter(
        0.3, unit="mean weight of agreeing cells", set_on="data not recorded, 2026-11-29"
    )
    """Cells of the frame whose agreement over levels is above this belong to the ruled sheet."""
