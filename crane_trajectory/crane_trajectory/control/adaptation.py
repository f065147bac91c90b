"""Dead zones and gains learnt while the crane moves, for each direction by itself.

While a joint moves one way with an open valve, its two edges pass, over a window,

    y = d + c_A o_A,    y = d + c_B o_B

y the mean spool, o what either edge must have been open for the oil that its chamber took or gave
(what the piston swept, what the pressure squeezed, what leaked) if the gains of the model held; d
is the dead zone, c_A and c_B correct the gains: K / c. The three are estimated by recursive least
squares that forget within `MEMORY`, only where a window tells something, and within bounds.
"""

import math

import numpy as np
from numba import njit

WINDOW = 0.1  # s
MEMORY = 20.0  # s of windows that were used
LEAST_OPENING = 0.02  # in a window: dead zone and gains must show in it
LARGEST_CHANGE = 0.5  # of the opening within a window: lags matter where it changes fast
NOISE = 0.003  # standard deviation of y - d - c o in a window
DEAD_ZONE_UNKNOWN, GAIN_UNKNOWN = 0.02, 0.3  # standard deviations at the beginning
DEAD_ZONE_BOUNDS = (0.0, 0.3)
GAIN_BOUNDS = (0.3, 3.0)

WINDOW_FIELDS = 9
"""Of the open window of a joint: time; integrals of root gain of A, of B, of these times y; oil
through either edge; least and largest y. See `adapt`."""
TIME, YIELD_A, YIELD_B, SPOOL_A, SPOOL_B, OIL_A, OIL_B, LEAST, LARGEST = range(WINDOW_FIELDS)


def begin(dead_zone_extend: np.ndarray, dead_zone_retract: np.ndarray) -> np.ndarray:
    """(j, 2, 4, 3) what the model says: of each direction, extending and retracting, d, c_A, c_B
    and below them their covariance (3, 3). The gains of a model are those of the whole stroke.
    """
    learnt = np.zeros((len(dead_zone_extend), 2, 4, 3))
    learnt[:, 0, 0, 0], learnt[:, 1, 0, 0] = dead_zone_extend, dead_zone_retract
    learnt[:, :, 0, 1] = learnt[:, :, 0, 2] = 1.0 - learnt[:, :, 0, 0]
    for k, unknown in enumerate((DEAD_ZONE_UNKNOWN, GAIN_UNKNOWN, GAIN_UNKNOWN)):
        learnt[:, :, 1 + k, k] = unknown**2
    return learnt


@njit(cache=True, error_model="numpy")
def adapt(
    learnt: np.ndarray,
    window: np.ndarray,
    spool: float,
    yield_a: float,
    yield_b: float,
    oil_a: float,
    oil_b: float,
    dt: float,
) -> None:
    """A cycle of a joint: `learnt` (2, 4, 3), `window` (9,) and the spool that was in force.

    `yield` [m3/s] is what an edge passes at an opening of 1 by the model, `oil` [m3] what passed in
    the last cycle, both positive in the direction of the spool.
    """
    side, size = (0, spool) if spool > 0.0 else (1, -spool)
    dead_zone, gain = learnt[side, 0, 0], learnt[side, 0, 1]
    open_enough = size - dead_zone > LEAST_OPENING * gain and size < 1.0
    turned = window[LARGEST] * spool < 0.0
    if not open_enough or turned or not math.isfinite(yield_a + yield_b + oil_a + oil_b):
        window[:] = 0.0
        return
    if window[TIME] == 0.0:
        window[LEAST] = window[LARGEST] = spool
    window[TIME] += dt
    window[YIELD_A] += dt * yield_a
    window[YIELD_B] += dt * yield_b
    window[SPOOL_A] += dt * yield_a * size
    window[SPOOL_B] += dt * yield_b * size
    window[OIL_A] += oil_a
    window[OIL_B] += oil_b
    window[LEAST] = min(window[LEAST], spool)
    window[LARGEST] = max(window[LARGEST], spool)
    if window[TIME] < WINDOW:
        return
    if window[LARGEST] - window[LEAST] < LARGEST_CHANGE * (size - dead_zone):
        _forget(learnt[side], window[TIME])
        y, opening = window[SPOOL_A] / window[YIELD_A], window[OIL_A] / window[YIELD_A]
        _update(learnt[side], y, opening, 1)
        y, opening = window[SPOOL_B] / window[YIELD_B], window[OIL_B] / window[YIELD_B]
        _update(learnt[side], y, opening, 2)
    window[:] = 0.0


@njit(cache=True, error_model="numpy")
def _forget(one: np.ndarray, time: float) -> None:
    """Grow the covariance, but never beyond that of the beginning."""
    growth = math.exp(time / MEMORY)
    sure = growth * max(one[2, 1], one[3, 2]) < GAIN_UNKNOWN**2
    if sure and growth * one[1, 0] < DEAD_ZONE_UNKNOWN**2:
        one[1:] *= growth


@njit(cache=True, error_model="numpy")
def _update(one: np.ndarray, y: float, opening: float, edge: int) -> None:
    """Recursive least squares of y = d + c o, c that of the edge 1 (A) or 2 (B)."""
    if not opening > 0.0:
        return
    values, covariance = one[0], one[1:]
    s = covariance[:, 0] + opening * covariance[:, edge]
    scale = NOISE * NOISE + s[0] + opening * s[edge]
    miss = y - values[0] - opening * values[edge]
    for k in range(3):
        low, high = DEAD_ZONE_BOUNDS if k == 0 else GAIN_BOUNDS
        values[k] = min(max(values[k] + s[k] / scale * miss, low), high)
        for m in range(3):
            covariance[k, m] -= s[k] * s[m] / scale


@njit(cache=True, error_model="numpy")
def at_bound(learnt: np.ndarray) -> bool:
    """Whether something learnt (2, 4, 3) lies at its bound; a dead zone of 0 is none."""
    for side in range(2):
        if learnt[side, 0, 0] >= DEAD_ZONE_BOUNDS[1]:
            return True
        for edge in range(1, 3):
            if not GAIN_BOUNDS[0] < learnt[side, 0, edge] < GAIN_BOUNDS[1]:
                return True
    return False
