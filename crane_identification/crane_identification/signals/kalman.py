"""Kalman filter and Rauch-Tung-Striebel smoother of each joint, driven by white jerk.

State: position, velocity, acceleration; measured: position. With positions counted in standard
deviations of one reading and time in 1/ω, where ω⁶ = (density of the jerk) / (variance of one
reading × step), the filter depends on the single number h = ω × step: Q is that of white jerk of
density h over h, and R = 1. The smoother's response is 1/(1 + (Ω/ω)⁶), so ω/2π is its bandwidth.
"""

from dataclasses import dataclass

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from numba import njit
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import minimize_scalar

from crane_identification.signals.motion import SmoothedMotion, checked
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

STATE_SIZE = 3
SHORTEST_RECORD = 20
DIFFUSE = 1e10  # variance of the unknown initial velocity and acceleration, in scaled units
CONVERGED = 1e-13  # relative change of the covariance per sample at which it is taken as constant
# Time constants that the likelihood leaves out while the filter finds its state
SETTLED_TIME_CONSTANTS = 10.0
HIGHEST_BANDWIDTH = 0.25  # of the sampling rate: above, nothing is smoothed


@dataclass(frozen=True)
class KalmanSmoother:
    """Smoother with a given expected jerk, or (default) tuned by the likelihood of the readings.

    `jerk_density` [(rad or m)²/s⁵], one per coordinate: the power density of the jerk, about its
    variance times its correlation time. `position_noise` [rad or m], one per coordinate: standard
    deviation of one reading. What is not given comes from the data: the noise is at least that of
    the encoder's rounding, resolution/√12, and both are the most likely ones for the readings.
    """

    jerk_density: tuple[float, ...] | None = None
    position_noise: tuple[float, ...] | None = None

    def estimate(
        self, position: np.ndarray, step: float, resolution: np.ndarray, progress: Progress = silent
    ) -> SmoothedMotion:
        """Motion at the times of `position` (n, j), `DataError` if there are too few samples."""
        position = checked(position, step, SHORTEST_RECORD)
        n, joints = position.shape
        states = np.empty((STATE_SIZE, n, joints))
        bandwidth, noise, velocity_noise = np.empty((3, joints))
        for j in range(joints):
            h, noise[j] = self._tuning(j, position[:, j], step, float(resolution[j]))
            omega = h / step
            scale = noise[j] * omega ** np.arange(STATE_SIZE)
            smoothed = smooth(position[:, j] / noise[j], h)
            states[:, :, j] = (smoothed * scale).T
            bandwidth[j] = omega / (2 * np.pi)
            velocity_noise[j] = scale[1] * np.sqrt(smoothed_covariance(h)[1, 1])
            progress("motion", (j + 1) / joints)
        return SmoothedMotion(states[0], states[1], states[2], bandwidth, noise, velocity_noise)

    def _tuning(
        self, j: int, readings: np.ndarray, step: float, resolution: float
    ) -> tuple[float, float]:
        """h and the standard deviation of one reading of coordinate j."""
        for name, values in (("jerk", self.jerk_density), ("noise", self.position_noise)):
            if values is not None and (len(values) <= j or not values[j] > 0):
                raise DataError(f"{name} of coordinate {j}: a positive value each, got {values}")
        rounding = resolution / np.sqrt(12)
        # Rounding errors of double precision keep the noise of a perfect sensor above zero.
        floor = max(rounding, 1e-12 * float(np.max(np.abs(readings))), np.finfo(float).tiny ** 0.25)
        fixed = self.position_noise[j] if self.position_noise else None
        if self.jerk_density is not None:
            noise = fixed or floor
            return step * (self.jerk_density[j] / (noise**2 * step)) ** (1 / 6), noise
        return most_likely(readings, floor, fixed)


def most_likely(readings: np.ndarray, floor: float, fixed: float | None) -> tuple[float, float]:
    """h and noise that maximise the likelihood of the innovations of the filter.

    The noise is the most likely one at each h but not below `floor`, or `fixed` where known.
    """
    n = len(readings)

    def cost(log_h: float) -> tuple[float, float]:
        h = float(np.exp(log_h))
        covariance = predicted_covariance(h)
        variance = covariance[0, 0] + 1.0
        settled = min(int(SETTLED_TIME_CONSTANTS / h), n // 2)
        innovations = innovate(readings, h, covariance[:, 0] / variance)[settled:]
        noise = fixed or max(float(np.sqrt(np.mean(innovations**2) / variance)), floor)
        misfit = np.mean(innovations**2) / (variance * noise**2)
        return np.log(variance) + 2 * np.log(noise) + misfit, noise

    bounds = (np.log(2 * np.pi / n), np.log(2 * np.pi * HIGHEST_BANDWIDTH))
    best = minimize_scalar(
        lambda log_h: cost(log_h)[0], bounds=bounds, method="bounded", options={"xatol": 0.01}
    )
    return float(np.exp(best.x)), cost(best.x)[1]


def scaled_filter(h: float) -> KalmanFilter:
    """The filter of the module's docstring before its first reading."""
    kalman = KalmanFilter(dim_x=STATE_SIZE, dim_z=1)
    kalman.F = np.array([[1.0, h, h * h / 2], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.R = np.eye(1)
    kalman.Q = Q_continuous_white_noise(dim=STATE_SIZE, dt=h, spectral_density=h)
    kalman.P = np.diag([1.0, DIFFUSE, DIFFUSE])
    return kalman


def predicted_covariance(h: float) -> np.ndarray:
    """Covariance (3, 3) of the prediction in the steady state."""
    kalman = scaled_filter(h)
    return solve_discrete_are(kalman.F.T, kalman.H.T, kalman.Q, kalman.R)


def smoothed_covariance(h: float) -> np.ndarray:
    """Covariance (3, 3) of the smoothed state, far from both ends."""
    kalman = scaled_filter(h)
    predicted = predicted_covariance(h)
    gain = predicted[:, :1] / (predicted[0, 0] + 1.0)
    filtered = predicted - gain @ predicted[:1]
    back = np.linalg.solve(predicted, kalman.F @ filtered).T
    return solve_discrete_lyapunov(back, filtered - back @ predicted @ back.T)


def smooth(readings: np.ndarray, h: float) -> np.ndarray:
    """Smoothed scaled states (n, 3) of scaled readings (n,).

    The gains depend on no reading: they are computed until they are constant (to rounding), and
    the loops over the readings carry the states alone.
    """
    kalman = scaled_filter(h)
    gains, covariances = _gains(kalman.F, kalman.Q, kalman.P, len(readings))
    predicted = kalman.F @ covariances @ kalman.F.T + kalman.Q
    back = np.swapaxes(np.linalg.solve(predicted, kalman.F @ covariances), 1, 2)
    states = _forward(readings, h, gains)
    return _backward(states, h, np.ascontiguousarray(back))


@njit(cache=True)
def _gains(
    transition: np.ndarray, disturbance: np.ndarray, start: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Gains (k, 3) and filtered covariances (k, 3, 3), k <= `most` until they are constant.

    In the form of Joseph, which keeps covariances positive in spite of a diffuse start.
    """
    gains, filtered = np.empty((most, STATE_SIZE)), np.empty((most, STATE_SIZE, STATE_SIZE))
    predicted = start.copy()
    for k in range(most):
        steady = k > 0
        for i in range(STATE_SIZE):
            gains[k, i] = predicted[i, 0] / (predicted[0, 0] + 1.0)
        for i in range(STATE_SIZE):  # (I - g h) P (I - g h)' + g g', where h = (1, 0, 0)
            left = predicted[i, 0] - gains[k, i] * predicted[0, 0]
            for j in range(STATE_SIZE):
                now = predicted[i, j] - gains[k, i] * predicted[0, j]
                now += (gains[k, i] - left) * gains[k, j]
                filtered[k, i, j] = now
                steady &= abs(now - filtered[k - 1, i, j]) <= CONVERGED * abs(now)
        if steady:
            return gains[: k + 1], filtered[: k + 1]
        predicted = transition @ filtered[k] @ transition.T + disturbance
    return gains, filtered


@njit(cache=True)
def innovate(readings: np.ndarray, h: float, gain: np.ndarray) -> np.ndarray:
    """Innovations (n,) of the filter with a constant gain (3,)."""
    out = np.zeros(len(readings))
    q, v, a = readings[0], 0.0, 0.0
    for k in range(len(readings)):
        error = readings[k] - q
        out[k] = error
        q, v, a = q + gain[0] * error, v + gain[1] * error, a + gain[2] * error
        q, v = q + h * v + 0.5 * h * h * a, v + h * a
    return out


@njit(cache=True)
def _forward(readings: np.ndarray, h: float, gains: np.ndarray) -> np.ndarray:
    states = np.empty((len(readings), 3))
    q, v, a = readings[0], 0.0, 0.0
    for k in range(len(readings)):
        gain = gains[min(k, len(gains) - 1)]
        error = readings[k] - q
        q, v, a = q + gain[0] * error, v + gain[1] * error, a + gain[2] * error
        states[k, 0], states[k, 1], states[k, 2] = q, v, a
        q, v = q + h * v + 0.5 * h * h * a, v + h * a
    return states


@njit(cache=True)
def _backward(states: np.ndarray, h: float, back: np.ndarray) -> np.ndarray:
    out = states.copy()
    for k in range(len(states) - 2, -1, -1):
        q, v, a = states[k]
        gain = back[min(k, len(back) - 1)]
        dq = out[k + 1, 0] - (q + h * v + 0.5 * h * h * a)
        dv = out[k + 1, 1] - (v + h * a)
        da = out[k + 1, 2] - a
        for i in range(3):
            out[k, i] += gain[i, 0] * dq + gain[i, 1] * dv + gain[i, 2] * da
    return out
