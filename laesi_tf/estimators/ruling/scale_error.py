"""Parameters of the error of a scale that was read."""

from dataclasses import dataclass

from laesi_tf.estimators.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class ScaleErrorParams:
    """Parameters of the error of a camera's scale."""

    waviness: float = parameter(
        0.06,
        unit="share of the scale per period",
        set_on="rendered (split develop), where 20 of 30 photos are within one standard deviation with it; "
        "2026-11-28",
    )
    """Error by the distance of the lines from the fit: waves of the paper move neighbouring lines together,
    so that the covariance, which takes windows as independent, misses them."""
    floor: float = parameter(0.0003, unit="share of the scale", set_on="as waviness")
    """Standard deviation that stays with the clearest ruling."""
