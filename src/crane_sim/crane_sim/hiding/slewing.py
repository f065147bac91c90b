"""Slewing while the booms are excited: what it does to them is no part of a planar model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_sim.effects.form import Planted
from crane_sim.effects.loads import HASTY_SLEWING, SLEWS, UNEVEN_SLEWING
from crane_sim.plant.closed_loop import Course
from crane_trajectory.motion.motion import Reference

SLEW = 0  # the first joint: all others move with it
OVERTONES = {HASTY_SLEWING: 3, UNEVEN_SLEWING: 2}  # of the swings of a law, beside themselves


@dataclass(frozen=True)
class Slewing:
    """A motion during which the slew swings to and fro: its speed, and rad of phase a second.

    The `share` of it is an `overtone` of the swings.
    """

    motion: Course
    speed: float  # rad/s, largest
    frequency: float  # rad/s
    share: float = 0.0
    overtone: int = 1

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
        speed = self.speed * np.array([1.0 - self.share, self.share])
        rate = omega * np.array([1.0, self.overtone])
        phase = np.multiply.outer(time, rate)
        way = (1.0 - np.cos(phase)) @ (speed / rate)
        return Reference(
            _with_slew(planar.position, way),
            _with_slew(planar.velocity, np.sin(phase) @ speed),
            _with_slew(planar.acceleration, np.cos(phase) @ (speed * rate)),
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
        law = effect.form.law
        if isinstance(law, int) and law in SLEWS:
            speed, frequency = effect.values[:2]
            share = sum(effect.values[2:])  # of laws that have one
            return Slewing(motion, speed, frequency, share, OVERTONES.get(law, 1))
    return motion
