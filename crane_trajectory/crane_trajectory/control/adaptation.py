"""Dead zones and gains learnt while the crane moves, for each direction by itself.

Over a window in which a joint moves one way with an open valve, its mean spool y and the mean
opening o that its measured motion shows obey y = d + c o: d the dead zone, c the travel of the
spool from there to fully open. Both are estimated by recursive least squares that forget within
`MEMORY`, only where a window tells something, and within bounds.
"""

import math

import numpy as np
from numba import njit

WINDOW = 0.1  # s
MEMORY = 20.0  # s of windows that were used
LEAST_OPENING = 0.02  # in a window: dead zone and gain must show in it
LARGEST_CHANGE = 0.5  # of the opening within a window: lags matter where it changes fast
NOISE = 0.003  # standard deviation of y - d - c o in a window
DEAD_ZONE_UNKNOWN, TRAVEL_UNKNOWN = 0.02, 0.3  # standard deviations at the beginning
DEAD_ZONE_BOUNDS = (0.0, 0.3)
TRAVEL_BOUNDS = (0.3, 3.0)

LEARNT = ("dead_zone", "travel", "variance_dead_zone", "covariance", "variance_travel")
"""What is known of a direction, the last axis of (j, 2, 5); direction 0 extends, 1 retracts."""
WINDOW_FIELDS = 8
"""Of the open window of a joint: time, integrals of g and g y, nothing, least and largest y, way and
direction when it began."""


def begin(dead_zone_extend: np.ndarray, dead_zone_retract: np.ndarray) -> np.ndarray:
    """(j, 2, 5) what the model says, not yet corrected."""
    learnt = np.zeros((len(dead_zone_extend), 2, len(LEARNT)))
    learnt[:, 0, 0], learnt[:, 1, 0] = dead_zone_extend, dead_zone_retract
    learnt[:, :, 1] = 1.0 - learnt[:, :, 0]
    learnt[:, :, 2], learnt[:, :, 4] = DEAD_ZONE_UNKNOWN**2, TRAVEL_UNKNOWN**2
    return learnt


@njit(cache=True, error_model="numpy")
def adapt(
    learnt: np.ndarray, window: np.ndarray, spool: float, speed: float, way: float, dt: float
) -> None:
    """A cycle of a joint: `learnt` (2, 5), `window` (8,) and the spool y that was in force.

    `speed` is g [m/s]; `way` [m] is where piston and compressed oil together are: x + F/(k_A+k_B).
    """
    side = 0 if spool > 0.0 else 1
    size, direction = abs(spool), 1.0 - 2.0 * side
    dead_zone, travel = learnt[side, 0], learnt[side, 1]
    open_enough = size - dead_zone > LEAST_OPENING * travel and size < 1.0
    if not open_enough or not math.isfinite(way + speed) or window[7] != direction:
        window[:] = 0.0
        window[4], window[5], window[6], window[7] = size, size, way, direction
        return
    window[0] += dt
    window[1] += dt * speed
    window[2] += dt * speed * size
    window[4], window[5] = min(window[4], size), max(window[5], size)
    if window[0] < WINDOW:
        return
    opening = direction * (way - window[6]) / window[1]
    y = window[2] / window[1]
    if window[5] - window[4] < LARGEST_CHANGE * (y - dead_zone) and opening > 0.0:
        _update(learnt[side], y, opening, window[0])
    window[:] = 0.0
    window[4], window[5], window[6], window[7] = size, size, way, direction


@njit(cache=True, error_model="numpy")
def _update(one: np.ndarray, y: float, opening: float, time: float) -> None:
    """Recursive least squares of y = d + c o; never less sure than at the beginning."""
    forget = math.exp(-time / MEMORY)
    p00, p01, p11 = one[2] / forget, one[3] / forget, one[4] / forget
    if p00 > DEAD_ZONE_UNKNOWN**2 or p11 > TRAVEL_UNKNOWN**2:
        p00, p01, p11 = one[2], one[3], one[4]
    s0, s1 = p00 + p01 * opening, p01 + p11 * opening
    scale = NOISE * NOISE + s0 + s1 * opening
    miss = y - one[0] - one[1] * opening
    one[0] = min(max(one[0] + s0 / scale * miss, DEAD_ZONE_BOUNDS[0]), DEAD_ZONE_BOUNDS[1])
    one[1] = min(max(one[1] + s1 / scale * miss, TRAVEL_BOUNDS[0]), TRAVEL_BOUNDS[1])
    one[2], one[3], one[4] = p00 - s0 * s0 / scale, p01 - s0 * s1 / scale, p11 - s1 * s1 / scale


@njit(cache=True, error_model="numpy")
def at_bound(learnt: np.ndarray) -> bool:
    """Whether something learnt (2, 5) lies at its bound; a dead zone of 0 is none."""
    for side in range(2):
        if learnt[side, 0] >= DEAD_ZONE_BOUNDS[1]:
            return True
        if not TRAVEL_BOUNDS[0] < learnt[side, 1] < TRAVEL_BOUNDS[1]:
            return True
    return False
