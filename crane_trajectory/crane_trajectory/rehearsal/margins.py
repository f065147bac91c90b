"""How much larger the gains of a controller may be, and how much later its commands."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_trajectory.rehearsal.trials import GainTrial, Tried

SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
DELAYS = (0.02, 0.05, 0.1, 0.15)  # s
WANTED_SCALE, WANTED_DELAY = 2.0, 0.05
SWINGING = 0.1  # ripple over speed, from which a joint swings
TRIALS = (
    *(GainTrial(scale, 0.0) for scale in SCALES),
    *(GainTrial(1.0, late) for late in DELAYS),
    GainTrial(WANTED_SCALE, WANTED_DELAY),
)


class JointMargins(NamedTuple):
    """Of a joint: the largest trials up to which it does not swing; 0 where it always does."""

    gain: float  # of the gains
    delay: float  # s
    both: bool  # whether it stands `WANTED_SCALE` and `WANTED_DELAY` at once

    @property
    def suffice(self) -> bool:
        """Whether they are as large as they ought to be."""
        return self.gain >= WANTED_SCALE and self.delay >= WANTED_DELAY

    @property
    def advised(self) -> float:
        """Of the gains: what leaves the margins that are wanted, as far as the trials tell."""
        by_gain = self.gain / WANTED_SCALE if self.gain else 0.25
        by_delay = max(self.delay / WANTED_DELAY, 0.25)
        return min(1.0, by_gain, by_delay)


def margins(tried: Tried, trials: Sequence[GainTrial] = TRIALS) -> tuple[JointMargins, ...]:
    """Of each joint, from trials that contain those of `TRIALS`."""
    stopped = np.array([one.stops for one in tried.worst])
    steady = (tried.ripple < SWINGING) & ~stopped[:, np.newaxis]
    found = []
    for column in steady.T:
        of = dict(zip(trials, column.tolist(), strict=True))
        gain = _largest([(one.scale, of[one]) for one in trials if one.late == 0.0])
        delay = _largest([(one.late, of[one]) for one in trials if one.scale == 1.0])
        found.append(JointMargins(gain, delay, of[GainTrial(WANTED_SCALE, WANTED_DELAY)]))
    return tuple(found)


def _largest(steps: list[tuple[float, bool]]) -> float:
    """The last value of increasing ones up to which all are steady; 0 without one."""
    last = 0.0
    for value, steady in steps:
        if not steady:
            break
        last = value
    return last
