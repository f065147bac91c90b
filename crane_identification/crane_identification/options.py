"""How recordings are turned into an estimate; the defaults take what they need from the data."""

from dataclasses import dataclass, field

from crane_identification.estimation.covariance import Covariance
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator


@dataclass(frozen=True)
class Options:
    """Choices of identification.

    `motion` estimates velocity and acceleration. With `average`, whole periods are averaged
    (37)-(38): `period` [s] (None: found in the reference), the last `periods` of them (None: all
    behind the transient). Without, `trim` samples are cut from both ends (None: those that the
    smoother's memory spoils). `mask_reversals` leaves out what happens where the sign of the
    velocity is not known; without, sgn is taken as it comes. `decimation` is the factor of the
    parallel filter (None: from the bandwidth of the motion; 1: no filter). `covariance` says what
    is assumed of the residual.
    """

    motion: MotionEstimator = field(default_factory=KalmanSmoother)
    average: bool = True
    period: float | None = None
    periods: int | None = None
    trim: tuple[int, int] | None = None
    mask_reversals: bool = True
    decimation: int | None = None
    covariance: Covariance = Covariance.CORRELATED
