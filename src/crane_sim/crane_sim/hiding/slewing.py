"""Slewing while the booms are excited: what it does to them is no part of a planar model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_sim.effects.form import Planted
from crane_sim.effects.loads import CENTRIFUGAL
from crane_sim.plant.closed_loop import Course
from crane_trajectory.motion.motion import Reference

SLEW = 0  # the first joint: all others move with it


@dataclass(frozen=True)
class Slewing:
    """A motion during which the slew swings to and fro: its speed, and rad of phase a second."""

    motion: Course
    speed: float  # rad/s, largest
    frequency: float  # rad/s

    @property
    def start(self) -> np.ndarray:
        """(j,) as that of the motion [rad, m]."""
        return self.motion.start

    @property
    def duration(self) -> float:
        """As that of the motion [s]."""
        return self.motion.duration

    def reference(self, time: np.ndarray) -> Reference:
        """That of the motion, with the slew; whole swings, so that it ends where it began."""
        planar = self.motion.reference(time)
        time = np.clip(np.atleast_1d(time), 0.0, self.duration)
        swings = max(round(self.frequency * self.duration / (2.0 * np.pi)), 1)
        omega = 2.0 * np.pi * swings / self.duration
        phase, reach = omega * time, self.speed / omega
        return Reference(
            _with_slew(planar.position, reach * (1.0 - np.cos(phase))),
            _with_slew(planar.velocity, reach * omega * np.sin(phase)),
            _with_slew(planar.acceleration, reach * omega**2 * np.cos(phase)),
            planar.phase,
        )

    def probe(self, time: np.ndarray) -> np.ndarray:
        """As that of the motion."""
        return self.motion.probe(time)


def _with_slew(values: np.ndarray, slewed: np.ndarray) -> np.ndarray:
    values = values.copy()
    values[:, SLEW] += slewed
    return values


def slewing(motion: Course, planted: Sequence[Planted]) -> Course:
    """The motion, with the slew if one of the effects is that of slewing."""
    for effect in planted:
        if effect.form.law == CENTRIFUGAL:
            return Slewing(motion, *effect.values)
    return motion
