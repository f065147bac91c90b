"""Joint trajectories through points in time: the third kind of trajectory, which does not repeat.

The joints are at rest at the first point and at the last one. Between points they follow the
polynomials that ros2_control uses: cubic for points with velocities, quintic with accelerations.
Points without velocities are joined by a cubic spline, whose acceleration is continuous.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from crane_model.configuration import Schema

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

MOST_POINTS = 5000
LONGEST_DURATION = 3600.0  # s
SHORTEST_STEP = 1e-3  # s, between two points
Values = Annotated[tuple[float, ...], Field(min_length=2, max_length=MOST_POINTS)]


class MotionSamples(NamedTuple):
    """Position, velocity and acceleration at n times of j joints, each (n, j) [SI]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class JointPoints(Schema):
    """Positions of one joint [rad or m], and their derivatives where they are given."""

    position: Values
    velocity: Values | None = None
    acceleration: Values | None = None


class PointsTrajectory(Schema):
    """A motion from rest to rest through points at n times [s] from 0; other joints are held.

    Each of `joints` has n positions [rad or m], n velocities or none, and n accelerations or none;
    the first and the last velocity are 0.
    """

    kind: Literal["points"]
    name: str
    time: Values
    joints: Annotated[dict[str, JointPoints], Field(min_length=1)]
    provenance: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        steps = np.diff(self.time)
        if self.time[0] != 0.0 or steps.min() < SHORTEST_STEP or self.time[-1] > LONGEST_DURATION:
            raise ValueError(
                f"time: must increase from 0 by at least {SHORTEST_STEP:g} s a point, to at most "
                f"{LONGEST_DURATION:g} s; got {self.time[0]:g} to {self.time[-1]:g} s, "
                f"least step {steps.min():g} s"
            )
        derivatives = {
            (points.velocity is None, points.acceleration is None)
            for points in self.joints.values()
        }
        if len(derivatives) > 1 or (True, False) in derivatives:
            raise ValueError(
                "joints: all need the same: positions, positions and velocities, or these and "
                "accelerations"
            )
        for joint, points in self.joints.items():
            for what, values in points.model_dump(exclude_none=True).items():
                if len(values) != len(self.time):
                    raise ValueError(
                        f"joints.{joint}.{what}: {len(values)} values for {len(self.time)} times; "
                        "give one for each"
                    )
            if points.velocity is not None and (points.velocity[0] or points.velocity[-1]):
                raise ValueError(
                    f"joints.{joint}.velocity: must be 0 at the first and at the last point, got "
                    f"{points.velocity[0]:g} and {points.velocity[-1]:g}"
                )
        return self

    @classmethod
    def of_arrays(
        cls,
        name: str,
        joints: Sequence[str],
        time: np.ndarray,
        position: np.ndarray,
        velocity: np.ndarray | None = None,
        acceleration: np.ndarray | None = None,
    ) -> Self:
        """The trajectory through positions (n, j) at times (n,) [s], with derivatives if known."""

        def column(values: np.ndarray | None, i: int) -> tuple[float, ...] | None:
            return None if values is None else tuple(values[:, i].tolist())

        return cls(
            kind="points",
            name=name,
            time=tuple(time.tolist()),
            joints={
                joint: JointPoints(
                    position=tuple(position[:, i].tolist()),
                    velocity=column(velocity, i),
                    acceleration=column(acceleration, i),
                )
                for i, joint in enumerate(joints)
            },
        )

    @property
    def period(self) -> float:
        """Duration from rest to rest [s]: it is run once."""
        return self.time[-1]

    @property
    def harmonics(self) -> int:
        """Number of harmonics of (32) whose half waves are as short as the shortest step."""
        shortest = max(float(np.diff(self.time).min()), self.period / MOST_POINTS)
        return int(np.ceil(self.period / (2.0 * shortest)))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""
        return tuple(self.joints)

    @property
    def probe(self) -> None:
        """Nothing is added to the commands."""

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Position, velocity and acceleration at time (n,) [s]; at rest before and after."""
        time = np.atleast_1d(time)
        course, rate, change = self._polynomials
        within = ((time >= 0.0) & (time <= self.period))[:, np.newaxis]
        inside = np.clip(time, 0.0, self.period)
        return MotionSamples(course(inside), within * rate(inside), within * change(inside))

    @cached_property
    def _polynomials(self) -> "tuple[PPoly, PPoly, PPoly]":
        from scipy.interpolate import BPoly, CubicSpline, PPoly  # half a second to import

        series = self.joints.values()
        given = [
            np.array([getattr(points, what) for points in series]).T
            for what in ("position", "velocity", "acceleration")
            if getattr(next(iter(series)), what) is not None
        ]
        if len(given) == 1:
            course: PPoly = CubicSpline(self.time, given[0], bc_type="clamped")
        else:
            course = PPoly.from_bernstein_basis(
                BPoly.from_derivatives(self.time, np.stack(given, axis=1))
            )
        return course, course.derivative(), course.derivative(2)
