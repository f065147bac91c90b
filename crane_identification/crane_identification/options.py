"""How recordings are turned into an estimate; the defaults take what they need from the data."""

import math
from dataclasses import dataclass
from enum import StrEnum

from crane_identification.signals.motion import MotionEstimator


class Estimator(StrEnum):
    """How Θ is found from the rows; what each is for is in its module under `estimation`."""

    LEAST_SQUARES = "least_squares"
    WEIGHTED = "weighted"
    ROBUST = "robust"
    INSTRUMENTAL = "instrumental"
    CONSISTENT = "consistent"


class Covariance(StrEnum):
    """What is assumed of the residual.

    CLASSICAL: white; its variance is its sum of squares over (rows - parameters).
    SAMPLE: white; its variance is the sample variance about its mean, as usual in robotics (EMPS).
    CORRELATED: an autoregressive process of its own in each joint.
    """

    CLASSICAL = "classical"
    SAMPLE = "sample"
    CORRELATED = "correlated"


@dataclass(frozen=True)
class Options:
    """Choices of identification.

    Commands read of each recording what lies between `begin` and `end` [s from its start], and of a
    bag the topics in `namespace` (None: the one that it holds), behind a low-pass at `rate` [Hz]
    (None: as recorded); `fit` takes logs as they were read.
    `motion` estimates velocity and acceleration (None: the best route for the kind of data). With
    `average`, whole periods are averaged (37)-(38): `period` [s] (None: found in the reference),
    the last `periods` of them (None: all behind the transient). Without, `trim` samples are cut
    from both ends (None: those that the smoother's memory spoils). `mask_reversals` leaves out what
    happens where the sign of the velocity is not known; without, sgn is taken as it comes.
    `decimation` is the factor of the parallel filter (None: from the bandwidth of the motion; 1: no
    filter). `covariance` says what is assumed of the residual. `estimator`: least squares (31)
    under physical constraints, which is plain least squares wherever that is physical, or another.

    >>> Options(begin=2.0, period=20.0).covariance
    <Covariance.CORRELATED: 'correlated'>
    """

    begin: float = 0.0
    end: float = math.inf
    namespace: str | None = None
    rate: float | None = None
    motion: MotionEstimator | None = None
    average: bool = True
    period: float | None = None
    periods: int | None = None
    trim: tuple[int, int] | None = None
    mask_reversals: bool = True
    decimation: int | None = None
    covariance: Covariance = Covariance.CORRELATED
    estimator: Estimator = Estimator.CONSISTENT
