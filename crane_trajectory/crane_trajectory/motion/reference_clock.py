"""The clock of a reference in real time: it runs with the samples, and brakes to a stop."""

import math
from copy import copy
from typing import NamedTuple

import numpy as np

from crane_trajectory.motion.motion import Motion, Phase, paced, running_up_once

# The largest deceleration on a stop is 1.5 times the speed by this time: at the limits of speed of
# the laboratory crane 0.2 rad/s2 to 0.7 m/s2.
BRAKE_TIME = 1.5  # s
LONGEST_STEP = 0.05  # s; after a longer gap, or a leap of the clock of the stamps, it goes on so


class Target(NamedTuple):
    """The reference of one instant: (j,) each [SI], and the phase."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    phase: Phase


class ReferenceClock:
    """Time of a motion, from `start` [s] on, at the rate 1 until it brakes.

    Braking runs the clock down smoothly, so the reference comes to rest on the path that was
    checked, never faster than it, within `BRAKE_TIME`.
    """

    def __init__(self, start: float):
        self.time = start
        self._braked_at: float | None = None  # time of the motion
        self._braking = 0.0  # s since

    @property
    def braking(self) -> bool:
        """Whether it brakes or has braked."""
        return self._braked_at is not None

    @property
    def stopped(self) -> bool:
        """Whether it stands still for good."""
        return self.braking and self._braking >= BRAKE_TIME

    def brake(self) -> None:
        """Run down from now on."""
        if self._braked_at is None:
            self._braked_at = self.time

    def advance(self, dt: float) -> None:
        """Let `dt` [s] of real time pass; at most `LONGEST_STEP` and never back."""
        dt = min(max(dt, 0.0), LONGEST_STEP)
        if self._braked_at is None:
            self.time += dt
            return
        self._braking = min(self._braking + dt, BRAKE_TIME)
        lost = BRAKE_TIME * self._run_down()[0]
        self.time = self._braked_at + self._braking - lost

    def later(self, time: float) -> "ReferenceClock":
        """As it will be in `time` [s], if nobody brakes meanwhile."""
        clock = copy(self)
        for _ in range(math.ceil(time / LONGEST_STEP)):
            clock.advance(min(time, LONGEST_STEP))
            time -= LONGEST_STEP
        return clock

    def target(self, motion: Motion) -> Target:
        """The reference of `motion` now."""
        point, phase = motion.at(self.time), motion.phase(self.time)
        if self.braking:
            _, lost_rate, change = self._run_down()
            point, phase = paced(point, 1.0 - lost_rate, -change / BRAKE_TIME), Phase.STOP
        position, velocity, acceleration = point
        return Target(position, velocity, acceleration, phase)

    def _run_down(self) -> tuple[float, float, float]:
        """Time, rate and change of its rate that the clock has lost, in units of `BRAKE_TIME`."""
        return running_up_once(self._braking / BRAKE_TIME)
