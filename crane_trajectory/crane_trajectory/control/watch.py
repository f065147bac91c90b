"""Whether transducers tell the truth and valves answer: one record a joint, for compiled loops."""

import math

import numpy as np
from numba import njit

from crane_trajectory.control.interface import ControlCondition

WATCH = ("last_a", "last_b", "same_a", "same_b", "bad", "silent", "astray")
"""Last readings [Pa], for how long they have not changed [s], for how long pressures stay unused
[s]; for how long the joint has not answered, has moved the wrong way [s]."""

STUCK = 0.2  # s without any change of a reading while the joint moves
USED_AGAIN = 1.0  # s after which pressures that were lost are used again
LOWEST_PRESSURE = -5.0e5  # Pa, gauge: less there is not
LARGEST_STEP = 8.0e6  # Pa from cycle to cycle
LARGEST_SHARE = 2.0  # of the supply pressure, in a chamber
LARGEST_MISFIT = 0.5  # of the largest force: measured against that of the model
OPEN = 0.05  # opening at which a joint surely moves
UNANSWERED = 0.5  # s
ASTRAY = 0.3  # s
NO_NEWS = int(ControlCondition.FOLLOWING)
SILENT, WRONG = int(ControlCondition.NO_ANSWER), int(ControlCondition.WRONG_MODEL)


@njit(cache=True, error_model="numpy")
def transducers_good(
    watch: np.record,
    area_a: float,
    area_b: float,
    supply: float,
    pressure_a: float,
    pressure_b: float,
    load: float,
    moving: bool,
    dt: float,
) -> bool:
    """Whether two readings [Pa] are finite, plausible, alive; `load` [N] is that of the model."""
    good = math.isfinite(pressure_a + pressure_b)
    if good:
        known = watch.last_a != 0.0 or watch.last_b != 0.0
        for p, last in ((pressure_a, watch.last_a), (pressure_b, watch.last_b)):
            good &= LOWEST_PRESSURE <= p <= LARGEST_SHARE * supply
            good &= not known or abs(p - last) <= LARGEST_STEP
        misfit = area_a * pressure_a - area_b * pressure_b - load
        good &= abs(misfit) <= LARGEST_MISFIT * area_a * supply
        same_a, same_b = pressure_a == watch.last_a, pressure_b == watch.last_b
        watch.same_a = watch.same_a + dt if same_a and moving else 0.0
        watch.same_b = watch.same_b + dt if same_b and moving else 0.0
        good &= max(watch.same_a, watch.same_b) < STUCK
        watch.last_a, watch.last_b = pressure_a, pressure_b
    if good:
        watch.bad = max(watch.bad - dt, 0.0)
    else:
        watch.bad = USED_AGAIN
    return watch.bad == 0.0


@njit(cache=True, error_model="numpy")
def answer(watch: np.record, opening: float, expected: float, velocity: float, dt: float) -> int:
    """`NO_NEWS`, or what is wrong with a joint: `expected` is its speed at the opening."""
    opened = abs(opening) > OPEN and math.isfinite(velocity)
    silent = opened and abs(velocity) < 0.1 * abs(expected)
    astray = opened and velocity * expected < 0.0 and abs(velocity) > 0.25 * abs(expected)
    watch.silent = watch.silent + dt if silent else 0.0
    watch.astray = watch.astray + dt if astray else 0.0
    if watch.astray > ASTRAY:
        return WRONG
    return SILENT if watch.silent > UNANSWERED else NO_NEWS
