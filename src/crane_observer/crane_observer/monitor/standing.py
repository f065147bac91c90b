"""Joints that stand though oil must flow: what tells a stuck encoder where no flow is known.

A valve that is open passes oil as long as the supply is above the pressures of both chambers,
and the piston goes; against a stop, or a load that is too heavy, the chamber that is fed comes up
to the supply. So either the encoder does not show the motion, or the valve does not open.
"""

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.monitor.blocks import LONGEST, Sample

OPEN = 0.3  # of the largest command, beyond the dead bands of all valves
LEFT = 1e6  # Pa of the supply above either chamber
LASTING = 0.3  # s


class StandingWatch:
    """Of j joints."""

    def __init__(self, joints: int):
        self._shown = np.full(joints, np.nan)
        self._time = -np.inf
        self.since = np.full(joints, np.inf)  # (j,) s, from when each stands so

    def add(self, sample: Sample, command: Array) -> None:
        """While `command` (j,) -1..1 is in force; behind a gap all begins anew."""
        left = sample.supply - np.maximum(sample.chamber_a, sample.chamber_b)
        stands = (sample.position == self._shown) & (np.abs(command) > OPEN) & (left > LEFT)
        stands &= sample.time - self._time < LONGEST
        self.since = np.where(stands, np.minimum(self.since, self._time), np.inf)
        self._time, self._shown = sample.time, sample.position

    @property
    def standing(self) -> Flags:
        """(j,) whether each has stood so for long enough."""
        return np.asarray(self._time - self.since > LASTING)
