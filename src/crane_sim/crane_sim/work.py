"""An operator at work: joystick commands of cycles such as dig and dump, without a reference.

He brings the machine from pose to pose by eye, several levers at a time. A lever goes where he
wants it within the time of a hand, farther the more he is in a hurry, and back before the joint is
there, because he knows that the machine answers late.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_trajectory.control.controller import ControlCondition, SensorReading, Wanted
from crane_trajectory.motion.motion import Phase, Reference

HAND_S = 0.15  # s, time constant of a lever
GLANCE_S = 0.2  # s between two decisions of the operator
EXPECTED_DELAY_S = 0.35  # s, by which he lets go of a lever early
LEVER = (0.3, 0.85)  # how far he moves a lever, from slow to in a hurry
LEAST_LEVER = 0.18  # that surely moves a joint
NEAR = 0.06  # rad or m: there
SLOWING = 0.25  # rad or m, on which he brings a lever back
LONGEST_STEP_S = 7.0  # s, after which he goes on to the next pose
PAUSE_S = (0.1, 0.8)  # s, between two poses


class WorkCycle(Schema):
    """Poses [rad, m] one after the other, and by how much an operator misses them (rms)."""

    poses: Annotated[tuple[dict[str, float], ...], Field(min_length=2)]
    scatter: Positive


def load_work(path: Path, machine: Machine) -> WorkCycle:
    """The work cycle in a file; `ConfigurationError` names joints and poses that cannot be."""
    cycle = load(path, WorkCycle)
    for number, pose in enumerate(cycle.poses, start=1):
        for joint, value in pose.items():
            if joint not in machine.joint_names:
                raise ConfigurationError(
                    f"{path}: pose {number}: no joint '{joint}'; {machine.name} has "
                    f"{', '.join(machine.joint_names)}"
                )
            limits = machine.limits[joint]
            if not limits.position_min <= value <= limits.position_max:
                raise ConfigurationError(
                    f"{path}: pose {number}: {joint} is {value:g}, must be "
                    f"{limits.position_min:g} to {limits.position_max:g}"
                )
    return cycle


@dataclass(frozen=True)
class WorkShift:
    """A motion of `duration` [s] from `start` (j,) without a reference, all of which is NaN."""

    start: np.ndarray
    duration: float

    def reference(self, time: np.ndarray) -> Reference:
        """(n, j) NaN at times (n,) [s]."""
        nothing = np.full((len(time), len(self.start)), np.nan)
        return Reference(nothing, nothing, nothing, np.full(len(time), Phase.EXCITATION))

    def probe(self, time: np.ndarray) -> np.ndarray:
        """(n, j) zero."""
        return np.zeros((len(time), len(self.start)))


class Joysticks:
    """A `Controller` that is an operator; the same seed gives the same habits."""

    preview = 0.0

    def __init__(self, machine: Machine, cycle: WorkCycle, seed: int, duration: float):
        """He stops in time before `duration` [s]."""
        self._machine, self._cycle = machine, cycle
        self._rng = np.random.default_rng([seed, 13])
        self._duration = duration
        joints = len(machine.joint_names)
        self.by_model = np.zeros(joints, dtype=bool)
        self._lever, self._wanted, self._hurry = np.zeros((3, joints))
        self._target: np.ndarray | None = None
        self._number = -1
        self._time = self._glance = 0.0
        self._since, self._pause = 0.0, 1.0

    def start(self, command: np.ndarray) -> None:
        """Take the levers at their positions `command` (j,)."""
        self._lever = np.array(command, dtype=float)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """Return the valve commands (j,), see `Controller`; `wanted` is not used."""
        self._time += dt
        if self._time >= self._glance and np.isfinite(reading.velocity).all():
            self._glance = self._time + GLANCE_S * self._rng.uniform(0.7, 1.3)
            self._decide(reading)
        self._lever += (self._wanted - self._lever) * dt / (dt + HAND_S)
        return np.where(np.abs(self._lever) < 0.02, 0.0, self._lever)

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        return (ControlCondition.FOLLOWING,) * len(self._lever)

    def _decide(self, reading: SensorReading) -> None:
        if self._target is None:
            self._target = reading.position.copy()
        if self._time > self._duration - 4.0:
            self._wanted[:] = 0.0
            return
        left = self._target - reading.position - EXPECTED_DELAY_S * reading.velocity
        there = (np.abs(left) < NEAR).all()
        if there or self._time - self._since > LONGEST_STEP_S:
            if self._pause > 0.0:
                self._pause -= GLANCE_S
                self._wanted[:] = 0.0
                return
            self._next()
            left = self._target - reading.position
        size = np.clip(np.abs(left) / SLOWING, 0.0, 1.0) * self._hurry
        moves = np.abs(left) >= NEAR
        self._wanted = np.where(moves, np.sign(left) * np.maximum(size, LEAST_LEVER), 0.0)

    def _next(self) -> None:
        assert self._target is not None
        self._number = (self._number + 1) % len(self._cycle.poses)
        for joint, value in self._cycle.poses[self._number].items():
            limits, span = self._machine.limits[joint], 0.1
            met = value + self._cycle.scatter * self._rng.standard_normal()
            low, high = limits.position_min + span, limits.position_max - span
            self._target[self._machine.index(joint)] = min(max(met, low), high)
        self._hurry = self._rng.uniform(*LEVER, len(self._hurry))
        self._since, self._pause = self._time, float(self._rng.uniform(*PAUSE_S))
