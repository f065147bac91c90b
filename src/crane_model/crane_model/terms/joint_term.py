"""Terms that act on one joint, at one instant or with a memory; springs and ends of the range."""

from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array, Flags
from crane_model.configuration import Angle, Positive
from crane_model.errors import ConfigurationError
from crane_model.motion_columns import MotionColumn, MotionQuantity, fill
from crane_model.record import Record
from crane_model.terms.term import Effect, Family, Parameter, Setting, Shape, Term

# Terms that act on one joint at one instant.


class OneJointTerm(Term):
    """A term on a single joint, with any number of parameters."""

    joint: str

    @classmethod
    def places(cls, setting: Setting) -> tuple[str | None, ...]:
        """Every joint of the model."""
        return tuple(setting.units)

    @property
    def only_joint(self) -> str | None:
        """The joint of its field."""
        return self.joint

    @abstractmethod
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The parameters, without the joint in their names."""

    @abstractmethod
    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Regressor columns on joint j: (n,), or (n, parameters)."""

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """Each named symbol.joint."""
        if self.joint not in setting.units:
            raise ConfigurationError(
                f"term '{self.type}': the model has no joint '{self.joint}'; "
                f"its joints are {', '.join(setting.units)}"
            )
        return tuple(
            parameter._replace(name=f"{parameter.name}.{self.joint}")
            for parameter in self.joint_parameters(setting)
        )

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """Zero but on the term's own joint."""
        j = record.column(self.joint)
        columns[:, j] = self.joint_columns(record, setting, j).reshape(len(record), -1)


class JointTerm(OneJointTerm):
    """A term with one parameter that depends on what its joint does at the same instant alone."""

    of_one_instant: ClassVar[bool] = True

    @abstractmethod
    def column(self, record: Record, j: int) -> Array:
        """The single regressor column on joint j: (n,)."""

    @abstractmethod
    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The single parameter."""
        return (self.parameter(setting.units[self.joint], setting.force_unit(self.joint)),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """The single column."""
        return self.column(record, j)


class MotionTerm(OneJointTerm):
    """A term whose columns are all proportional to what single joints do at the same instant."""

    of_one_instant: ClassVar[bool] = True

    @abstractmethod
    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """The columns."""

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """The same, compiled."""
        fill(self.motion_columns(setting), record, columns)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Those of its own joint."""
        return self.columns(record, setting)[:, j]


class ProportionalTerm(MotionTerm):
    """A term with one parameter, times a quantity of its joint's motion."""

    quantity: ClassVar[MotionQuantity]

    @abstractmethod
    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The single parameter."""
        return (self.parameter(setting.units[self.joint], setting.force_unit(self.joint)),)

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """The single column."""
        return (MotionColumn(self.joint, 0, self.quantity, self.joint),)


# Terms whose force depends on what came before.


class MemoryTerm(Term):
    """A term with s states that follow the motion.

    Over a recording the states are traced from the start of each run; in forward simulation they
    are advanced beside the motion, and the record brings them along.
    """

    @abstractmethod
    def start(self, record: Record, setting: Setting) -> Array:
        """States (n, s) of n runs that begin at the samples of the record, s >= 1."""

    @abstractmethod
    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """States (n, s) of n runs one step on; the records hold the two ends of the step."""

    def trace(self, record: Record, setting: Setting) -> Array:
        """States (n, s) at each sample of a recording: `advance` from sample to sample."""
        states = self.start(record, setting)
        first = record.first_of_run
        for k in range(1, len(record)):
            if not first[k]:
                step = record.take(slice(k - 1, k)), record.take(slice(k, k + 1))
                states[k] = self.advance(states[k - 1 : k], *step, setting)[0]
        return states

    def states(self, record: Record, setting: Setting) -> Array:
        """States (n, s) that the record brings along, or else traced over it."""
        known = (record.memory or {}).get(self)
        return self.trace(record, setting) if known is None else known


class JointMemoryTerm(MemoryTerm, OneJointTerm):
    """A term with memory and one parameter, on a single joint."""

    @abstractmethod
    def column(self, states: Array, record: Record, j: int) -> Array:
        """The single regressor column on joint j, given the states (n, s): (n,)."""

    @abstractmethod
    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The single parameter."""
        return (self.parameter(setting.units[self.joint], setting.force_unit(self.joint)),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """The single column."""
        return self.column(self.states(record, setting), record, j)


# Gas springs, which carry a part of the weight of an arm.


class GasSpring(JointTerm):
    """tau = s p A dL/dq: a piston between a pin `distance` from the joint and one on a `crank`.

    L^2 = distance^2 + crank^2 - 2 distance crank cos(q + angle) is the length between the pins, and
    p = `pressure` `volume` / (`volume` - A (L - distance + crank)) that of gas at one temperature,
    which the piston compresses as it is drawn out of its shortest length. s, the parameter, is 1 as
    the data sheet has it. Over a small range of q it can hardly be told from weight: give a prior.
    """

    type: Literal["gas_spring"] = "gas_spring"
    family: ClassVar[Family] = "gravity and load"

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
        """p A dL/dq: (n,) [N m]; nan where the gas has no room left."""
        angle = record.position[:, j] + self.angle
        both = self.distance * self.crank
        length = np.sqrt(self.distance**2 + self.crank**2 - 2.0 * both * np.cos(angle))
        left = self.volume - self.area * (length - self.distance + self.crank)
        pressure = self.pressure * self.volume / np.where(left > 0.0, left, np.nan)
        torque: Array = pressure * self.area * both * np.sin(angle) / length
        return torque

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("gas_spring", "1", 0.0, "force of the gas spring over its data sheet's")


# Resistance near the ends of the range of a joint.

End = Literal["lower", "upper"]
FLOWS = 2  # laminar and turbulent: parameters of each end


class EndCushioning(OneJointTerm):
    """(f + h |q'|) q' d/zone, with d how deep the joint stands within a `zone` before a limit.

    Cushions throttle the oil on the last part of the stroke: a gap does in proportion to the speed,
    an orifice to its square. Each of the `ends` has f and h of its own; of others nothing is known.
    Limits are those of Table 2.
    """

    type: Literal["end_cushioning"] = "end_cushioning"
    family: ClassVar[Family] = "hydraulics"
    effect: ClassVar[Effect] = Effect(
        "end cushioning",
        "resistance to motion near the ends of the range only",
        ("position_friction",),
        "sweeps into both ends of the range at several speeds",
        follows=("position",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "zone": Shape(0.02, 0.3, "rad or m", 6, "length of the zone before each limit")
    }
    former: ClassVar[Mapping[str, str]] = MappingProxyType(
        {"f_e": "each end has a laminar and a turbulent resistance of its own"}
    )

    zone: float = Field(gt=0)
    ends: tuple[End, ...] = Field(default=("lower", "upper"), min_length=1)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        if setting.machine is None or self.joint not in setting.machine.limits:
            raise ConfigurationError(
                f"term '{self.type}': needs a machine with limits of joint '{self.joint}'"
            )
        force, coordinate = setting.force_unit(self.joint), setting.units[self.joint]
        laminar, turbulent = f"{force} s/{coordinate}", f"{force} s2/{coordinate}2"
        return tuple(
            one
            for end in self.ends
            for one in (
                Parameter(f"f_{end}", laminar, 0.0, f"viscous resistance at the {end} end"),
                Parameter(f"h_{end}", turbulent, 0.0, f"turbulent resistance at the {end} end"),
            )
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """q' d/zone and q'|q'| d/zone of each of the ends: (n, parameters)."""
        assert setting.machine is not None  # parameters() refuses such a model
        limits, q = setting.machine.limits[self.joint], record.position[:, j]
        to_end = {"lower": q - limits.position_min, "upper": limits.position_max - q}
        v = record.velocity[:, j]
        columns = np.empty((len(q), FLOWS * len(self.ends)))
        for k, end in enumerate(self.ends):
            columns[:, FLOWS * k] = v * np.maximum(0.0, 1.0 - to_end[end] / self.zone)
            columns[:, FLOWS * k + 1] = columns[:, FLOWS * k] * np.abs(v)
        return columns

    @override
    def showing(self, shown: Flags) -> Self:
        """Without ends that were not visited; as it is where neither was."""
        visited = np.flatnonzero(shown.reshape(-1, FLOWS).any(axis=1))
        ends = tuple(self.ends[k] for k in visited)
        return self.model_copy(update={"ends": ends}) if ends else self
