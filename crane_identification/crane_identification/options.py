"""Options of identification; defaults that depend on the data are None."""

import math
from dataclasses import dataclass
from enum import StrEnum

from crane_identification.signals.motion import MotionEstimator


class Estimator(StrEnum):
    """Estimator of the parameters Θ from the rows of (29).

    LEAST_SQUARES: (31) as it stands. WEIGHTED: weighted by the covariance of the noise between
    joints. ROBUST: Tukey's bisquare, which outliers do not bias. INSTRUMENTAL: instruments along
    the recorded reference, unbiased under feedback. CONSISTENT: least squares among physically
    consistent parameters, which is (31) wherever that is consistent.

    >>> Estimator("robust")
    <Estimator.ROBUST: 'robust'>
    """

    LEAST_SQUARES = "least_squares"
    WEIGHTED = "weighted"
    ROBUST = "robust"
    INSTRUMENTAL = "instrumental"
    CONSISTENT = "consistent"


class Covariance(StrEnum):
    """Assumption about the residual, from which standard deviations follow.

    CLASSICAL: white; its variance is its sum of squares over (rows - parameters).
    SAMPLE: white; its variance is the sample variance about its mean, as usual in robotics (EMPS).
    CORRELATED: an autoregressive process of its own in each joint.

    >>> [str(assumption) for assumption in Covariance]
    ['classical', 'sample', 'correlated']
    """

    CLASSICAL = "classical"
    SAMPLE = "sample"
    CORRELATED = "correlated"


@dataclass(frozen=True)
class Options:
    """Options of identification.

    Parameters
    ----------
    begin, end : float
        Part of each recording that commands use [s from its start]; `fit` takes logs as they are.
    namespace : str, optional
        Namespace of the topics in a bag; None: the one that the bag holds.
    rate : float, optional
        Rate [Hz] to which commands resample, behind a low-pass; None: as recorded.
    motion : MotionEstimator, optional
        Estimator of velocity and acceleration; None: the best one for the kind of data.
    average : bool
        Average whole periods, (37)-(38).
    period : float, optional
        Period to average over [s]; None: found in the reference or the positions.
    periods : int, optional
        Number of periods to average, the last ones; None: all behind the transient.
    trim : tuple of two ints, optional
        Samples to cut from both ends if nothing is averaged; None: those that the memory of the
        smoother spoils.
    mask_reversals : bool
        Leave out rows at which the sign of the velocity is not known.
    decimation : int, optional
        Factor of the parallel filter, 1 for no filter; None: from the bandwidth of the motion.
    covariance : Covariance
        Assumption about the residual.
    estimator : Estimator
        Estimator of the parameters.

    Examples
    --------
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
