"""From the filter's state to what a scale shows."""

import math
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_observer.scale.filter import MASS, Balanced, LoadFilter

CENTRED = 0.01  # m, standard deviation of the centre of a load that hangs at the tip
ELSEWHERE = 3.0  # standard deviations, from which on it does not hang there
KNOWN_CENTRE = 0.1  # m, standard deviation up to which motion has told the centre


class TipLoad(NamedTuple):
    """What hangs at the tip, beyond what was tared."""

    mass: float  # kg
    deviation: float  # kg, standard deviation
    centre: float  # m beyond the tip, along the line from the last joint; NaN where not known
    centre_deviation: float  # m; NaN where not known


def load_of(mean: Array, spread: Array) -> TipLoad:
    """From mass and moment, mean (2,) and covariance (2, 2). A load hangs at the tip itself unless
    motion tells that it does not.
    """
    m, s = mean
    by_moment = math.sqrt(spread[1, 1])
    centre, centre_deviation = math.nan, math.nan
    if m > 0.0:
        slope = np.array([-s / m, 1.0]) / m
        off = math.sqrt(float(slope @ spread @ slope))
        if off < KNOWN_CENTRE:
            centre, centre_deviation = s / m, off
    if abs(s) < ELSEWHERE * by_moment or math.isnan(centre):
        gain = spread[0, 1] / (spread[1, 1] + (CENTRED * m) ** 2)
        m, variance = m - gain * s, spread[0, 0] - gain * spread[0, 1]
    else:
        variance = spread[0, 0]
    return TipLoad(float(m), math.sqrt(max(variance, 0.0)), float(centre), float(centre_deviation))


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
