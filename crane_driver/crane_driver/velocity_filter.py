"""Velocity and acceleration of the joints while they move: a causal Kalman filter.

Each joint is a chain of position, velocity and acceleration driven by white jerk, the
constant-acceleration model of Bar-Shalom, Li and Kirubarajan, Estimation with Applications to
Tracking and Navigation, sec. 6.2.3 (filterpy: Q_continuous_white_noise). The covariance follows
the actual sample times, so jitter needs no special case.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

UNKNOWN_VELOCITY = 10.0  # rad/s or m/s; standard deviation before the second sample
# s; before the second sample the acceleration is what jerk makes of it in this time
JERK_MEMORY_S = 1.0
LONGEST_READING_PAUSE_S = 0.1  # without a reading, after which a joint begins anew


class JointMotion(NamedTuple):
    """Motion of j joints; NaN where it is not known."""

    position: np.ndarray  # (j,) rad, m
    velocity: np.ndarray  # (j,) rad/s, m/s
    acceleration: np.ndarray  # (j,) rad/s², m/s²


class VelocityFilter:
    """Filter of j joints that are sampled together.

    Parameters
    ----------
    jerk_density : array_like, shape (j,)
        Expected jerk squared times the time for which it lasts [(rad or m)²/s⁵].
    resolution : array_like, shape (j,)
        Step of the encoders [rad or m]; a reading has the variance resolution²/12.

    Raises
    ------
    ValueError
        If a value is not positive, or the shapes differ.
    """

    def __init__(self, jerk_density: ArrayLike, resolution: ArrayLike):
        self._density = np.array(jerk_density, dtype=float)
        self._noise = np.array(resolution, dtype=float) ** 2 / 12
        if self._density.shape != self._noise.shape or self._density.ndim != 1:
            raise ValueError("jerk_density and resolution: one value a joint")
        if not (np.all(self._density > 0) and np.all(self._noise > 0)):
            raise ValueError("jerk_density and resolution must be positive")
        joints = len(self._density)
        self._last = np.full(joints, -np.inf)
        self._state = np.zeros((joints, 3))
        self.covariance = np.zeros((joints, 3, 3))

    def update(self, stamp: float, position: Sequence[float] | np.ndarray) -> JointMotion:
        """Estimate the motion of the joints from their newest readings.

        A reading that is not newer than the last one changes nothing. A pause longer than
        `LONGEST_READING_PAUSE_S`, or a clock that went back by more, resets the joint.

        Parameters
        ----------
        stamp
            Time of the readings [s].
        position : array_like, shape (j,)
            Readings [rad, m]; NaN if there is none.

        Returns
        -------
        JointMotion
            Position, velocity and acceleration, each of shape (j,). All three are NaN for a joint
            whose reading is NaN, velocity and acceleration at its first reading and after a reset.

        Raises
        ------
        ValueError
            If the number of joints differs.
        """
        readings = np.asarray(position, dtype=float)
        if readings.shape != self._density.shape:
            raise ValueError(f"{len(self._density)} joints, got positions of {readings.shape}")
        estimate = np.empty((3, len(self._density)))
        _update(
            stamp,
            readings,
            self._last,
            self._state,
            self.covariance,
            self._density,
            self._noise,
            estimate,
        )
        return JointMotion(*estimate)


@njit(cache=True)
def _update(
    stamp: float,
    readings: np.ndarray,
    last: np.ndarray,
    state: np.ndarray,
    covariance: np.ndarray,
    density: np.ndarray,
    noise: np.ndarray,
    estimate: np.ndarray,
) -> None:
    for j in range(len(readings)):
        x, p = state[j], covariance[j]
        if np.isnan(readings[j]):
            estimate[:, j] = np.nan
            continue
        dt = stamp - last[j]
        if abs(dt) > LONGEST_READING_PAUSE_S:
            last[j] = stamp
            x[:] = readings[j], np.nan, np.nan
            estimate[:, j] = x
            continue
        if dt > 0:
            if np.isnan(x[1]):
                x[1] = x[2] = 0.0
                p[:] = 0.0
                p[0, 0] = noise[j]
                p[1, 1] = UNKNOWN_VELOCITY**2
                p[2, 2] = density[j] * JERK_MEMORY_S
            last[j] = stamp
            _predict(x, p, dt, density[j])
            _correct(x, p, readings[j], noise[j])
        estimate[:, j] = x


@njit(cache=True)
def _predict(x: np.ndarray, p: np.ndarray, dt: float, density: float) -> None:
    """x <- F x and P <- F P F' + Q in place, F = [[1, dt, dt²/2], [0, 1, dt], [0, 0, 1]]."""
    half = dt * dt / 2
    x[0] += dt * x[1] + half * x[2]
    x[1] += dt * x[2]
    for i in range(3):
        p[0, i] += dt * p[1, i] + half * p[2, i]
        p[1, i] += dt * p[2, i]
    for i in range(3):
        p[i, 0] += dt * p[i, 1] + half * p[i, 2]
        p[i, 1] += dt * p[i, 2]
    p[0, 0] += density * dt**5 / 20
    p[0, 1] += density * dt**4 / 8
    p[1, 0] += density * dt**4 / 8
    p[0, 2] += density * dt**3 / 6
    p[2, 0] += density * dt**3 / 6
    p[1, 1] += density * dt**3 / 3
    p[1, 2] += density * dt**2 / 2
    p[2, 1] += density * dt**2 / 2
    p[2, 2] += density * dt


@njit(cache=True)
def _correct(x: np.ndarray, p: np.ndarray, reading: float, noise: float) -> None:
    innovation, variance = reading - x[0], p[0, 0] + noise
    k0, k1, k2 = p[0, 0] / variance, p[1, 0] / variance, p[2, 0] / variance
    x[0] += k0 * innovation
    x[1] += k1 * innovation
    x[2] += k2 * innovation
    for i in range(3):
        measured = p[0, i]
        p[0, i] -= k0 * measured
        p[1, i] -= k1 * measured
        p[2, i] -= k2 * measured
