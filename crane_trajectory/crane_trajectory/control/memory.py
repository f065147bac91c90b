"""What the controllers that use the model remember from cycle to cycle: see `cycle`."""

from typing import NamedTuple

import numpy as np
from numba import njit

HISTORY = 64  # cycles of load and spool that are remembered

STATE = (
    "begun",  # whether the first cycle is over
    "condition",  # `ControlCondition`
    "command",
    "opening",  # last
    "bump",  # opening that is left of a transition
    "integral",  # rad/s, m/s
    "error",  # smoothed, rad, m
    "load",  # N, piston force ahead
    "pressed",  # whether the pressures are used
    "slow",  # N, slow part of what the measured force has more
    "p_a",  # Pa, last; NaN where not used
    "p_b",
    "stood",  # m, where the piston was
    "squeezed",  # m, by which the oil gives way more than the load of the model asks
    "turned",  # spool: the farthest since it turned, for its play
    "direction",  # of the spool
)
"""Fields of what a joint remembers from cycle to cycle."""


class CycleSetting(NamedTuple):
    """What does not change while the controller runs; j joints."""

    hydraulics: np.ndarray  # (j,) records
    gains: np.ndarray  # (j,) records of `FeedbackGains`
    tables: np.ndarray  # (j, KNOTS, 4) geometry
    fitted: np.ndarray  # (j,) bool: transducers to be used
    adaptive: bool
    by_force: bool
    preview: float  # s


class Memory(NamedTuple):
    """What changes."""

    state: np.ndarray  # (j,) records, fields STATE
    watch: np.ndarray  # (j,) records, fields WATCH
    learnt: np.ndarray  # (j, 2, 4, 3), see `adaptation`
    windows: np.ndarray  # (j, WINDOW_FIELDS)
    forces: np.ndarray  # (j, HISTORY) piston forces of the model [N]
    spools: np.ndarray  # (j, HISTORY)


@njit(cache=True, error_model="numpy")
def before(history: np.ndarray, count: int, cycles: float) -> float:
    """What was noted `cycles` (whole ones and a share) before the one with the number `count`."""
    cycles = min(cycles, float(min(count, HISTORY - 2)))
    whole = int(cycles)
    newer = history[(count - whole) % HISTORY]
    older = history[(count - min(whole + 1, count)) % HISTORY]
    return newer + (cycles - whole) * (older - newer)
