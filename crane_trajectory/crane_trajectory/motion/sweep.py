"""Sweeps at constant speed with dwells: the second kind of periodic trajectory.

A joint goes from one position to the next at constant speed, or dwells where two positions are
equal. Corners are rounded by a moving average over `corner` seconds with a parabolic weight: speed
and acceleration are continuous, no position and no speed is passed that the corners do not have,
and half of `corner` away from them the motion is exactly uniform.
"""

from functools import partial
from typing import Annotated, Literal, Self

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from crane_model.configuration import Schema
from crane_trajectory.motion.fourier import Instants, MotionSamples, Period
from crane_trajectory.motion.probe import Probe

Knots = Annotated[tuple[float, ...], Field(min_length=2, max_length=500)]


class JointCourse(Schema):
    """Positions [rad or m] of one joint at increasing times [s], from 0 to the period."""

    time: Knots
    position: Knots

    @model_validator(mode="after")
    def _periodic(self) -> Self:
        if len(self.time) != len(self.position):
            raise ValueError(
                f"time has {len(self.time)} entries and position {len(self.position)}; "
                "give a position for every time"
            )
        if self.time[0] != 0.0 or np.diff(self.time).min() <= 0.0:
            raise ValueError(f"time: must begin with 0 and increase, got {list(self.time)}")
        if self.position[0] != self.position[-1]:
            raise ValueError(
                f"position: the last must be the first, {self.position[0]:g}, for the motion is "
                f"periodic; got {self.position[-1]:g}"
            )
        return self


class SweepTrajectory(Schema):
    """A periodic trajectory of sweeps and dwells; joints that it does not name are held."""

    kind: Literal["sweep"]
    name: str
    period: Period
    corner: Annotated[float, Field(ge=0.1)]  # s, over which corners are rounded
    joints: Annotated[dict[str, JointCourse], Field(min_length=1)]
    probe: Probe | None = None
    provenance: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for joint, course in self.joints.items():
            if course.time[-1] != self.period:
                raise ValueError(
                    f"joints.{joint}.time: must end with the period {self.period:g} s, "
                    f"got {course.time[-1]:g} s"
                )
        if self.corner > self.period:
            raise ValueError(f"corner: at most the period {self.period:g} s, got {self.corner:g} s")
        return self

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""
        return tuple(self.joints)

    @property
    def harmonics(self) -> int:
        """Of a Fourier series (32) whose half waves are as short as two corners."""
        return int(np.ceil(self.period / (4.0 * self.corner)))

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Position, velocity, acceleration at time (n,) [s]; columns as in `joint_names`."""
        phase = np.mod(np.atleast_1d(time), self.period)
        columns = [self._course(self.joints[joint], phase) for joint in self.joint_names]
        return MotionSamples(*np.stack(columns, axis=-1))

    def instants(self) -> Instants:
        """Return what gives the rows of `evaluate` (3, j) at one time [s], compiled."""
        courses = [self.joints[joint] for joint in self.joint_names]
        ends = np.cumsum([0, *(len(course.time) for course in courses)])
        knots = np.concatenate([course.time for course in courses])
        positions = np.concatenate([course.position for course in courses])
        return partial(_courses, ends, knots, positions, self.corner)

    def _course(self, course: JointCourse, phase: np.ndarray) -> np.ndarray:
        """(3, n): the polygon, corrected within half of `corner` of every change of its speed."""
        knots, positions = np.array(course.time), np.array(course.position)
        speeds = np.diff(positions) / np.diff(knots)
        segment = np.clip(np.searchsorted(knots, phase, side="right") - 1, 0, len(speeds) - 1)
        motion = np.stack(
            [
                positions[segment] + speeds[segment] * (phase - knots[segment]),
                speeds[segment],
                np.zeros_like(phase),
            ]
        )
        changes = speeds - np.roll(speeds, 1)
        since = phase - knots[:-1, np.newaxis] + self.period / 2
        since = np.mod(since, self.period) - self.period / 2
        motion += np.einsum("k,ckn->cn", changes, np.stack(_rounding(since, self.corner)))
        return motion


def _rounding(time: np.ndarray, corner: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit step of speed at time 0, averaged over `corner`, less the step itself."""
    s = np.minimum(np.maximum(time / corner + 0.5, 0.0), 1.0)
    near = np.abs(time) < corner / 2
    return (
        near * (corner * s**3 * (1.0 - s / 2.0) - np.maximum(time, 0.0)),
        near * (s**2 * (3.0 - 2.0 * s) - (time >= 0.0)),
        6.0 * s * (1.0 - s) / corner,
    )


_rounding_once = njit(cache=True)(_rounding)  # at one time


@njit(cache=True)
def _courses(
    ends: np.ndarray, knots: np.ndarray, positions: np.ndarray, corner: float, time: float
) -> np.ndarray:
    """Courses at one time [s]: (3, j); those of joint i have the knots ends[i]:ends[i + 1]."""
    motion = np.zeros((3, len(ends) - 1))
    for i in range(len(ends) - 1):
        t, p = knots[ends[i] : ends[i + 1]], positions[ends[i] : ends[i + 1]]
        period, last = t[-1], len(t) - 1
        phase = time % period
        before = (p[last] - p[last - 1]) / (t[last] - t[last - 1])
        position = speed_now = 0.0
        for k in range(last):
            speed = (p[k + 1] - p[k]) / (t[k + 1] - t[k])
            if phase >= t[k]:
                position, speed_now = p[k] + speed * (phase - t[k]), speed
            since = (phase - t[k] + period / 2) % period - period / 2
            rounded = _rounding_once(since, corner)
            for c in range(3):
                motion[c, i] += (speed - before) * rounded[c]
            before = speed
        motion[0, i] += position
        motion[1, i] += speed_now
    return motion
