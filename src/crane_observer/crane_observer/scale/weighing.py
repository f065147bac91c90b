"""From the filter's state to what a scale shows."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_observer.scale.filter import MASS, MOMENT, Balanced, LoadFilter

CENTRED = 0.01  # m, standard deviation of the centre of a load that hangs at the tip
ELSEWHERE = 5.0  # standard deviations, from which on it does not hang there: accelerations are told
# badly, and by the same errors in window after window
KNOWN_CENTRE = 0.1  # m, standard deviation up to which motion has told the centre


class TipLoad(NamedTuple):
    """What hangs at the tip, beyond what was tared."""

    mass: float  # kg
    deviation: float  # kg, standard deviation
    centre: float  # m beyond the tip, along the line from the last joint; NaN where not known
    centre_deviation: float  # m; NaN where not known


@njit(cache=True, error_model="numpy")
def load_of(x: Array, P: Array) -> TipLoad:
    """From the state x (size,) of a filter and its covariance P (size, size). A load hangs at the
    tip itself unless motion tells that it does not.
    """
    m, s, variance = x[MASS], x[MOMENT], P[MASS, MASS]
    centre, centre_deviation = math.nan, math.nan
    if m > 0.0:
        off = P[MOMENT, MOMENT] - 2.0 * s / m * P[MASS, MOMENT] + (s / m) ** 2 * variance
        off = math.sqrt(max(off, 0.0)) / m
        if off < KNOWN_CENTRE:
            centre, centre_deviation = s / m, off
    if abs(s) < ELSEWHERE * math.sqrt(P[MOMENT, MOMENT]) or math.isnan(centre):
        gain = P[MASS, MOMENT] / (P[MOMENT, MOMENT] + (CENTRED * m) ** 2)
        m, variance = m - gain * s, variance - gain * P[MASS, MOMENT]
    return TipLoad(m, math.sqrt(max(variance, 0.0)), centre, centre_deviation)


def mean_load(loads: Sequence[TipLoad], likely: Sequence[float]) -> TipLoad:
    """The mean of loads of which one hangs there, with what they differ by in its deviation; how
    likely each is, logarithms. Its centre is that of the first.
    """
    share = np.exp(np.array(likely) - max(likely))
    share /= share.sum()
    masses = np.array([one.mass for one in loads])
    variances = np.array([one.deviation**2 for one in loads])
    mean = float(share @ masses)
    variance = float(share @ (variances + (masses - mean) ** 2))
    return loads[0]._replace(mass=mean, deviation=math.sqrt(variance))


def attainable(known: LoadFilter, window: Balanced) -> float:
    """Standard deviation [kg] that a weighing can have in this pose and motion, however long it
    takes: what a model may be wrong about stays.
    """
    H, _, variance = known.innovation(window)
    load, H = H[:, MASS].copy(), H.copy()
    H[:, :3] = 0.0
    prior = known.prior
    information = load @ np.linalg.solve((H * prior**2) @ H.T + np.diag(variance), load)
    return math.inf if information <= 0.0 else 1.0 / math.sqrt(float(information))
