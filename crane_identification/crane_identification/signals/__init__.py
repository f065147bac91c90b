"""From measured positions to velocity and acceleration."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.signals.butterworth import (
        ButterworthDifferentiator as ButterworthDifferentiator,
    )
    from crane_identification.signals.fourier import FourierFit as FourierFit
    from crane_identification.signals.kalman import KalmanSmoother as KalmanSmoother
    from crane_identification.signals.motion import Motion as Motion
    from crane_identification.signals.motion import MotionEstimator as MotionEstimator

_HOMES = {
    "ButterworthDifferentiator": "butterworth",
    "FourierFit": "fourier",
    "KalmanSmoother": "kalman",
    "Motion": "motion",
    "MotionEstimator": "motion",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
