"""Which route to velocity and acceleration is taken for which kind of data.

One whole period, averaged: the Fourier fit. A record that is not periodic: the Kalman smoother. On
the stand-in machine, whose true motion is known, each is the best of the three routes for its kind
(tests/benchmarks/test_signal_routes.py prints the scores).
"""

import numpy as np

from crane_identification.signals.fourier import FourierFit
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator, SmoothedMotion
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent


def estimate_record(
    estimator: MotionEstimator | None,
    position: np.ndarray,
    step: float,
    resolution: np.ndarray,
    progress: Progress = silent,
) -> SmoothedMotion:
    """Motion of a record (n, j) with two ends; `DataError` for an estimator of whole periods."""
    if isinstance(estimator, FourierFit):
        raise DataError(
            "the Fourier fit needs averaged, whole periods; average, or take the Kalman smoother"
        )
    return (estimator or KalmanSmoother()).estimate(position, step, resolution, progress)


def estimate_period(
    estimator: MotionEstimator | None,
    position: np.ndarray,
    step: float,
    resolution: np.ndarray,
    progress: Progress = silent,
) -> SmoothedMotion:
    """Motion over one whole period (n, j), which continues over its ends.

    For estimators that know no periods, half a period is put before and behind, which is far more
    than they remember.
    """
    if estimator is None or isinstance(estimator, FourierFit):
        return (estimator or FourierFit()).estimate(position, step, resolution, progress)
    n = len(position)
    half = n // 2
    extended = np.concatenate([position[n - half :], position, position[:half]])
    motion = estimator.estimate(extended, step, resolution, progress)
    return motion.during(slice(half, half + n))
