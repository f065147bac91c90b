"""From measured positions to velocity and acceleration."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.signals.butterworth import (
        ButterworthDifferentiator as ButterworthDifferentiator,
    )
    from crane_identification.signals.fourier import FourierFit as FourierFit
    from crane_identification.signals.kalman import KalmanSmoother as KalmanSmoother
    from crane_identification.signals.motion import MotionEstimator as MotionEstimator
    from crane_identification.signals.motion import SmoothedMotion as SmoothedMotion

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "butterworth": ("ButterworthDifferentiator",),
        "fourier": ("FourierFit",),
        "kalman": ("KalmanSmoother",),
        "motion": ("SmoothedMotion", "MotionEstimator"),
    },
)
