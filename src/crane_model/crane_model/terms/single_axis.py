"""Terms that, with friction, describe any one-axis machine."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.configuration import Angle, Positive
from crane_model.errors import ConfigurationError
from crane_model.motion_columns import MotionQuantity
from crane_model.record import Record
from crane_model.terms.joint_term import JointTerm, OneJointTerm, ProportionalTerm
from crane_model.terms.term import Effect, Parameter, Setting, Shape


class Inertia(ProportionalTerm):
    """J q'': the inertia that one axis moves."""

    type: Literal["inertia"] = "inertia"
    family = "rigid body"
    quantity = MotionQuantity.ACCELERATION
    symbol = Parameter("inertia", "{inertia}", 0.0, "inertia moved by the joint")


class Gravity(OneJointTerm):
    """tau = g_s sin q + g_c cos q: weight on a body that turns about one horizontal axis.

    For a mass m at the distance r from the axis, q0 above the horizontal where q = 0:
    g_c = m g r cos q0, g_s = -m g r sin q0. It knows nothing of axes that carry this one.
    """

    type: Literal["gravity"] = "gravity"
    family = "gravity and load"

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """g_s, g_c; `ConfigurationError` for a joint that does not turn."""
        if setting.units[self.joint] != "rad":
            raise ConfigurationError(
                f"term 'gravity': joint '{self.joint}' slides, its weight is a constant force: use "
                "the term 'offset'"
            )
        return (
            Parameter("g_s", "N m", None, "weight times lever at q = 90 degrees"),
            Parameter("g_c", "N m", None, "weight times lever at q = 0"),
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        q = record.position[:, j]
        return np.stack([np.sin(q), np.cos(q)], axis=1)


class Offset(ProportionalTerm):
    """tau = f_0, a constant force: the drive's or the sensor's zero."""

    type: Literal["offset"] = "offset"
    family = "sensing"
    effect = Effect(
        "constant force",
        "a constant force, whatever the motion",
        ("coulomb_asymmetry", "pressure_offset"),
        "readings of the force sensors without load",
    )
    quantity = MotionQuantity.ONE
    symbol = Parameter("offset", "{force}", None, "constant force")


class GasSpring(JointTerm):
    """tau = s p A dL/dq: a piston between a pin `distance` from the joint and one on a `crank`.

    L^2 = distance^2 + crank^2 - 2 distance crank cos(q + angle) is the length between the pins, and
    p = `pressure` `volume` / (`volume` - A (L - distance + crank)) that of gas at one temperature,
    which the piston compresses as it is drawn out of its shortest length. s, the parameter, is 1 as
    the data sheet has it. Over a small range of q it can hardly be told from weight: give a prior.
    """

    type: Literal["gas_spring"] = "gas_spring"
    family = "gravity and load"
    symbol = Parameter("gas_spring", "1", 0.0, "force of the gas spring over its data sheet's")

    distance: Annotated[Positive, Field(examples=[0.8])]  # m
    crank: Annotated[Positive, Field(examples=[0.2])]  # m
    angle: Annotated[Angle, Field(examples=[0.1])]  # of the crank to the far pin where q = 0
    area: Annotated[Positive, Field(examples=[1.7e-3])]  # m2 that the gas acts on
    pressure: Annotated[Positive, Field(examples=[16e6])]  # Pa at the shortest length
    volume: Annotated[Positive, Field(examples=[1e-3])]  # m3 there

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """s; `ConfigurationError` for a joint that does not turn."""
        if setting.units.get(self.joint) == "m":
            raise ConfigurationError(
                f"term 'gas_spring': joint '{self.joint}' slides; a gas spring works on a crank"
            )
        return super().joint_parameters(setting)

    def column(self, record: Record, j: int) -> Array:
        angle = record.position[:, j] + self.angle
        both = self.distance * self.crank
        length = np.sqrt(self.distance**2 + self.crank**2 - 2.0 * both * np.cos(angle))
        left = self.volume - self.area * (length - self.distance + self.crank)
        pressure = self.pressure * self.volume / np.where(left > 0.0, left, np.nan)
        torque: Array = pressure * self.area * both * np.sin(angle) / length
        return torque


End = Literal["lower", "upper"]
FLOW_REGIMES = 2  # laminar and turbulent: parameters of each end


class EndCushioning(OneJointTerm):
    """(f + h |q'|) q' d/zone, with d how deep the joint stands within a `zone` before a limit.

    Cushions throttle the oil on the last part of the stroke: a gap does in proportion to the speed,
    an orifice to its square. Each of the `ends` has f and h of its own; of others nothing is known.
    Limits are those of Table 2.
    """

    type: Literal["end_cushioning"] = "end_cushioning"
    family = "hydraulics"
    effect = Effect(
        "end cushioning",
        "resistance to motion near the ends of the range only",
        ("position_friction",),
        "sweeps into both ends of the range at several speeds",
        follows=("position",),
    )
    shapes = {"zone": Shape(0.02, 0.3, "rad or m", 6, "length of the zone before each limit")}

    zone: float = Field(gt=0)
    ends: tuple[End, ...] = Field(default=("lower", "upper"), min_length=1)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        if setting.machine is None or self.joint not in setting.machine.limits:
            raise ConfigurationError(
                f"term '{self.type}': needs a machine with limits of joint '{self.joint}'"
            )
        force, coordinate = setting.force_unit(self.joint), setting.units[self.joint]
        laminar, turbulent = f"{force} s/{coordinate}", f"{force} s2/{coordinate}2"
        return tuple(
            parameter
            for end in self.ends
            for parameter in (
                Parameter(f"f_{end}", laminar, 0.0, f"viscous resistance at the {end} end"),
                Parameter(f"h_{end}", turbulent, 0.0, f"turbulent resistance at the {end} end"),
            )
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        assert setting.machine is not None  # parameters() refuses such a model
        limits, q = setting.machine.limits[self.joint], record.position[:, j]
        to_end = {"lower": q - limits.position_min, "upper": limits.position_max - q}
        v = record.velocity[:, j]
        columns = np.empty((len(q), FLOW_REGIMES * len(self.ends)))
        for k, end in enumerate(self.ends):
            columns[:, FLOW_REGIMES * k] = v * np.maximum(0.0, 1.0 - to_end[end] / self.zone)
            columns[:, FLOW_REGIMES * k + 1] = columns[:, FLOW_REGIMES * k] * np.abs(v)
        return columns

    def showing(self, shown: Flags) -> Self:
        """Without ends that were not visited; as it is where neither was."""
        visited = np.flatnonzero(shown.reshape(-1, FLOW_REGIMES).any(axis=1))
        ends = tuple(self.ends[k] for k in visited)
        return self.model_copy(update={"ends": ends}) if ends else self
