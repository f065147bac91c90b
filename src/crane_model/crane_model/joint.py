"""The joints of a machine: axis, frame, limits, and the joint that each one follows."""

import math
import re
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, SerializeAsAny, model_validator

from crane_model.actuators import Actuator, actuator_from_mapping
from crane_model.array import Array
from crane_model.configuration import Angle, Direction, Positive, Schema

# Frames: rotations and homogeneous transforms (1) from angles, axes and lengths [rad, m].


def denavit_hartenberg(
    theta: Array | float, d: Array | float, a: float, alpha: float, n: int
) -> Array:
    """A_i = Rot_z,theta Trans_z,d Trans_x,a Rot_x,alpha (1), (n, 4, 4)."""
    cos, sin = np.cos(theta), np.sin(theta)
    cos_alpha, sin_alpha = np.cos(alpha), np.sin(alpha)
    transform = np.zeros((n, 4, 4))
    transform[:, 0, 0], transform[:, 1, 0] = cos, sin
    transform[:, 0, 1], transform[:, 1, 1] = -sin * cos_alpha, cos * cos_alpha
    transform[:, 0, 2], transform[:, 1, 2] = sin * sin_alpha, -cos * sin_alpha
    transform[:, 2, 1], transform[:, 2, 2] = sin_alpha, cos_alpha
    transform[:, 0, 3], transform[:, 1, 3] = a * cos, a * sin
    transform[:, 2, 3] = d
    transform[:, 3, 3] = 1.0
    return transform


def about(axis: Array, angle: Array) -> Array:
    """Turns of (n,) angles about a unit axis (3,), Rodrigues: (n, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    turned: Array = np.eye(3) + sin * cross + (1.0 - cos) * (cross @ cross)
    return turned


def placement(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """(4, 4) of an origin as in URDF: turned about fixed x, then y, then z, and moved by xyz."""
    roll, pitch, yaw = ((math.cos(angle), math.sin(angle)) for angle in rpy)
    turn_x = np.array([[1, 0, 0], [0, roll[0], -roll[1]], [0, roll[1], roll[0]]])
    turn_y = np.array([[pitch[0], 0, pitch[1]], [0, 1, 0], [-pitch[1], 0, pitch[0]]])
    turn_z = np.array([[yaw[0], -yaw[1], 0], [yaw[1], yaw[0], 0], [0, 0, 1]])
    placed = np.eye(4)
    placed[:3, :3] = turn_z @ turn_y @ turn_x
    placed[:3, 3] = xyz
    return placed


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """The angles of `placement` for a rotation (3, 3)."""
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # roll and yaw turn alike: all to roll
        return math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])


Vector = tuple[float, float, float]
_WORD = re.compile(r"[A-Za-z]\w*")


def _word(name: str) -> str:
    if not _WORD.fullmatch(name):
        raise ValueError(f"must be letters, digits and '_', a letter first, got '{name}'")
    return name


class DenavitHartenberg(Schema):
    """A row of Table 1 [m, rad]; the joint moves about or along z of the frame before (1).

    q is added to theta of a joint that turns, to d of one that slides.
    """

    theta: Direction = 0.0
    d: float = 0.0
    a: float = 0.0
    alpha: Direction = 0.0


class Origin(Schema):
    """A place in the frame before, as in URDF: moved by `xyz` [m], turned by `rpy` [rad]."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: tuple[Direction, Direction, Direction] = (0.0, 0.0, 0.0)

    @cached_property
    def matrix(self) -> Array:
        """(4, 4)."""
        return placement(self.xyz, self.rpy)


class JointLimits(Schema):
    """A row of Table 2 [rad or m, and per s]."""

    position_min: Angle
    position_max: Angle
    velocity_min: Annotated[float, Field(lt=0)]
    velocity_max: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.position_min < self.position_max:
            raise ValueError(
                f"position_min {self.position_min} must be below position_max {self.position_max}"
            )
        return self

    @property
    def middle(self) -> float:
        """Position in the middle of the range [rad, m]."""
        return (self.position_min + self.position_max) / 2.0

    @property
    def slower_speed(self) -> float:
        """The smaller of the two limits of speed [per s]: the joint may reach it either way."""
        return min(-self.velocity_min, self.velocity_max)

    @property
    def top_speed(self) -> float:
        """The larger of the two limits of speed [per s]."""
        return max(-self.velocity_min, self.velocity_max)


class Follows(Schema):
    """Which joint's coordinate, times `ratio`, is also that of this joint."""

    joint: str
    ratio: float = 1.0


class MachineJoint(Schema):
    """One joint. Its place is a row `dh`, or an `origin` in the frame before and an `axis` in it.

    A joint that `follows` another, as the second telescope that a chain pulls, has neither limits
    nor actuator: it is no coordinate of its own.
    """

    name: Annotated[str, AfterValidator(_word)]
    kind: Literal["revolute", "prismatic"]
    dh: DenavitHartenberg | None = None
    origin: Origin | None = None
    axis: Vector | None = None
    follows: Follows | None = None
    limits: JointLimits | None = None
    latency: Annotated[float, Field(ge=0)] = 0.0  # s, by which its reading is older than its stamp
    actuator: Annotated[SerializeAsAny[Actuator], BeforeValidator(actuator_from_mapping)] | None = (
        None
    )

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.dh is None) == (self.axis is None) or (self.dh and self.origin):
            raise ValueError(
                "write where it is either as dh: {theta, d, a, alpha} or as origin: {xyz, rpy} "
                "and axis: [x, y, z]"
            )
        if self.axis is not None and not np.linalg.norm(self.axis) > 0.0:
            raise ValueError(f"axis: must not be zero, got {list(self.axis)}")
        return self

    @model_validator(mode="after")
    def _moved(self) -> Self:
        if self.follows is not None:
            if self.limits or self.actuator:
                raise ValueError(
                    f"follows {self.follows.joint}: must have neither limits nor actuator"
                )
        elif self.limits is None or self.actuator is None:
            lacking = "limits" if self.limits is None else "actuator"
            raise ValueError(f"{lacking} is required, but absent")
        return self

    @model_validator(mode="after")
    def _driven_all_over_its_range(self) -> Self:
        if self.limits is not None and self.actuator is not None:
            try:
                self.actuator.check(self.limits.position_min, self.limits.position_max)
            except ValueError as error:
                raise ValueError(f"linkage of {self.name} over its limits: {error}") from None
        return self

    @property
    def unit(self) -> str:
        """Unit of the coordinate: rad or m."""
        return "rad" if self.kind == "revolute" else "m"

    @cached_property
    def before(self) -> Array:
        """(4, 4) from the frame before to the joint, which moves about or along `direction`."""
        return np.eye(4) if self.origin is None else self.origin.matrix

    @cached_property
    def direction(self) -> Array:
        """(3,) unit vector of the axis."""
        axis = np.array(self.axis or (0.0, 0.0, 1.0), dtype=float)
        direction: Array = axis / np.linalg.norm(axis)
        return direction

    @cached_property
    def after(self) -> Array:
        """(4, 4) from the joint that has moved to the frame of its link."""
        if self.dh is None:
            return np.eye(4)
        row = self.dh
        placed: Array = denavit_hartenberg(row.theta, row.d, row.a, row.alpha, 1)[0]
        return placed

    def transform(self, q: Array) -> Array:
        """(n,) coordinates to (n, 4, 4): from the frame before to that of its link (1)."""
        turns = self.kind == "revolute"
        if self.dh is not None:
            theta, d = (q, 0.0) if turns else (0.0, q)
            row = self.dh
            return denavit_hartenberg(row.theta + theta, row.d + d, row.a, row.alpha, len(q))
        moved = np.tile(np.eye(4), (len(q), 1, 1))
        if turns:
            moved[:, :3, :3] = about(self.direction, q)
        else:
            moved[:, :3, 3] = q[:, np.newaxis] * self.direction
        transform: Array = self.before @ moved
        return transform
