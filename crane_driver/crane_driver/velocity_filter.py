"""Velocity and acceleration of the joints while they move: a causal Kalman filter.

Each joint is a chain of position, velocity and acceleration driven by white jerk, the
constant-acceleration model of Bar-Shalom, Li and Kirubarajan, Estimation with Applications to
Tracking and Navigation, sec. 6.2.3 (filterpy: Q_continuous_white_noise). The covariance follows
the actual sample times, so jitter needs no special case.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

UNKNOWN_VELOCITY = 10.0  # rad/s or m/s; standard deviation before the second sample
MEMORY = 1.0  # s; before the second sample the acceleration is what jerk makes of it in this time


class VelocityFilter:
    """Filter of j joints that are sampled together.

    jerk_density: (j,) [(rad or m)²/s⁵], expected jerk squared times the time for which it lasts.
    resolution: (j,) [rad or m], step of the encoders; a reading has the variance resolution²/12.
    gap: [s], a longer time without a reading resets a joint.
    """

    def __init__(self, jerk_density: ArrayLike, resolution: ArrayLike, gap: float = 0.1):
        self._density = np.array(jerk_density, dtype=float)
        self._noise = np.array(resolution, dtype=float) ** 2 / 12
        if self._density.shape != self._noise.shape or self._density.ndim != 1:
            raise ValueError("jerk_density and resolution: one value a joint")
        if not (np.all(self._density > 0) and np.all(self._noise > 0) and gap > 0):
            raise ValueError("jerk_density, resolution and gap must be positive")
        joints = len(self._density)
        self._gap = gap
        self._last = np.full(joints, -np.inf)
        self._state = np.zeros((joints, 3))
        self.covariance = np.zeros((joints, 3, 3))

    def update(
        self, stamp: float, position: Sequence[float] | np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity, acceleration (j,) of the joints from their readings at `stamp` [s].

        NaN where they are not known: all three of a joint whose reading is NaN, velocity and
        acceleration at a joint's first reading, and after a reset. A reading that is not newer
        than the last one changes nothing, unless the clock went back by more than `gap`: a reset.
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
            self._gap,
            estimate,
        )
        return estimate[0], estimate[1], estimate[2]


@njit(cache=True)
def _update(
    stamp: float,
    readings: np.ndarray,
    last: np.ndarray,
    state: np.ndarray,
    covariance: np.ndarray,
    density: np.ndarray,
    noise: np.ndarray,
    gap: float,
    estimate: np.ndarray,
) -> None:
    for j in range(len(readings)):
        x, p = state[j], covariance[j]
        if np.isnan(readings[j]):
            estimate[:, j] = np.nan
            continue
        dt = stamp - last[j]
        if abs(dt) > gap:
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
                p[2, 2] = density[j] * MEMORY
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
    """The state and covariance after one reading of the position."""
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
