"""A recording as it came from the machine, on one time base, for its figure (Fig. 9)."""

from dataclasses import dataclass

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample
from crane_identification.signals.butterworth import ButterworthDifferentiator
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator, encoder_resolution
from crane_model.cylinders import generalized_forces
from crane_model.model_file import Model


@dataclass(frozen=True)
class Recording:
    """n samples of j joints; a row of NaN stands in each gap. None: not logged.

    `time` (n,) [s]; positions [rad or m], the estimated `velocity` [per s], the generalized
    `force` [N m or N] and the reference (n, j).
    """

    source: str
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    reference_position: np.ndarray | None
    reference_velocity: np.ndarray | None


def recorded(
    model: Model, log: Log, motion: MotionEstimator | None, bandwidth: np.ndarray
) -> Recording:
    """The whole of `log`, not averaged: forces through (27) where the log holds pressures.

    What tunes itself is a Kalman smoother here, set to the `bandwidth` (j,) [Hz] found for the
    averaged motion, so that both are smoothed alike, and without another search.
    """
    samples = resample(log)
    force = _forces(model, samples)
    resolution = encoder_resolution(log.position.value)
    estimator = _tuned(motion, bandwidth, 1.0 / samples.rate)
    runs = [np.flatnonzero(samples.run == run) for run in np.unique(samples.run)]
    velocity = np.full_like(samples.position, np.nan)
    for rows in runs:
        estimate = estimator.estimate(samples.position[rows], 1.0 / samples.rate, resolution)
        velocity[rows] = estimate.velocity
    gaps = np.array([rows[-1] + 1 for rows in runs[:-1]], dtype=int)

    def opened(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.insert(values, gaps, np.nan, axis=0)

    return Recording(
        source=log.source,
        time=np.insert(samples.time, gaps, samples.time[gaps - 1] + 1.0 / samples.rate),
        position=np.insert(samples.position, gaps, np.nan, axis=0),
        velocity=np.insert(velocity, gaps, np.nan, axis=0),
        force=np.insert(force, gaps, np.nan, axis=0),
        reference_position=opened(samples.reference_position),
        reference_velocity=opened(samples.reference_velocity),
    )


def _forces(model: Model, samples: Samples) -> np.ndarray:
    if samples.force is not None:
        return samples.force
    assert model.machine is not None and samples.pressure_a is not None  # the fit refused such logs
    assert samples.pressure_b is not None
    return generalized_forces(
        model.machine, samples.position, samples.pressure_a, samples.pressure_b, model.joints
    )


def _tuned(motion: MotionEstimator | None, bandwidth: np.ndarray, step: float) -> MotionEstimator:
    if isinstance(motion, ButterworthDifferentiator):
        return motion
    if isinstance(motion, KalmanSmoother) and motion.jerk_density is not None:
        return motion
    # With readings of unit noise, the density of the jerk alone sets the bandwidth.
    density = step * (2 * np.pi * bandwidth) ** 6
    return KalmanSmoother(tuple(density.tolist()), (1.0,) * len(bandwidth))
