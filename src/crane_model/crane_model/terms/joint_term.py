"""Terms that act on one joint, at one instant or with a memory; springs and ends of the range."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from crane_model.array import Array
from crane_model.cylinders import cylinder_geometry
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn, MotionQuantity, fill
from crane_model.record import Record
from crane_model.terms.term import Parameter, Setting, Term

# Terms that act on one joint at one instant.


class OneJointTerm(Term):
    """A term on a single joint, with any number of parameters: its `symbols`, without the joint.

    In their units {coordinate}, {force} and {inertia} stand for those of the joint. A term that is
    `of_cylinder` needs a machine with a cylinder there.
    """

    symbols: ClassVar[tuple[Parameter, ...]] = ()
    of_cylinder: ClassVar[bool] = False

    joint: str

    @classmethod
    def places(cls, setting: Setting) -> tuple[str | None, ...]:
        return tuple(setting.units)

    @property
    def only_joint(self) -> str | None:
        return self.joint

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The parameters, without the joint in their names."""
        if self.of_cylinder:
            cylinder_machine(self, setting, self.joint)
        units = setting.units[self.joint], setting.force_unit(self.joint)
        return tuple(symbol.in_units(*units) for symbol in self.symbols)

    @abstractmethod
    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """Regressor columns on joint j: (n,), or (n, parameters)."""

    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
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
        j = record.column(self.joint)
        columns[:, j] = self.joint_columns(record, setting, j).reshape(len(record), -1)


class OneParameterTerm(OneJointTerm):
    """A term on a single joint with one parameter, its `symbol`."""

    symbol: ClassVar[Parameter]

    def parameter(self, coordinate: str, force: str) -> Parameter:
        """The single parameter, given the units of the joint's coordinate and force."""
        return self.symbol.in_units(coordinate, force)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        return (self.parameter(setting.units[self.joint], setting.force_unit(self.joint)),)


class JointTerm(OneParameterTerm):
    """A term with one parameter that depends on what its joint does at the same instant alone."""

    of_one_instant: ClassVar[bool] = True

    @abstractmethod
    def column(self, record: Record, j: int) -> Array:
        """The single regressor column on joint j: (n,)."""

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.column(record, j)


class MotionTerm(OneJointTerm):
    """A term whose columns are all proportional to what single joints do at the same instant."""

    of_one_instant: ClassVar[bool] = True

    @abstractmethod
    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """The columns."""

    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        fill(self.motion_columns(setting), record, columns)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.columns(record, setting)[:, j]


class ProportionalTerm(OneParameterTerm, MotionTerm):
    """A term with one parameter, times a quantity of its joint's motion."""

    quantity: ClassVar[MotionQuantity]

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
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


class JointMemoryTerm(MemoryTerm, OneParameterTerm):
    """A term with memory and one parameter, on a single joint."""

    @abstractmethod
    def column(self, states: Array, record: Record, j: int) -> Array:
        """The single regressor column on joint j, given the states (n, s): (n,)."""

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.column(self.states(record, setting), record, j)


# Cylinders as terms see them: lever arm, and the force of each chamber.


def cylinder_machine(term: Term, setting: Setting, joint: str) -> Machine:
    """The machine; `ConfigurationError` unless the model has one with a cylinder at `joint`."""
    machine = setting.machine
    if machine is None or joint not in machine.cylinders:
        raise ConfigurationError(
            f"term '{term.type}': needs a machine with a cylinder at joint '{joint}'; "
            + ("the model has no machine" if machine is None else f"it has {_listed(machine)}")
        )
    return machine


def lever(setting: Setting, joint: str, record: Record) -> Array:
    """dx/dq of (18), (n,); 1 where the model has no machine."""
    return lever_and_slope(setting, joint, record)[0]


def lever_and_slope(setting: Setting, joint: str, record: Record) -> tuple[Array, Array]:
    """dx/dq of (18) and d2x/dq2, (n,) each; 1 and 0 where the model has no machine."""
    q = record.position[:, record.column(joint)]
    if setting.machine is None:
        return np.ones_like(q), np.zeros_like(q)
    return cylinder_geometry(setting.machine, joint, q)[1:]


def chamber_forces(term: Term, record: Record, setting: Setting, joint: str) -> Array:
    """dx/dq A p of chambers A and B: (n, 2) generalized forces; areas are 1 without a machine."""
    j = record.column(joint)
    pressures = [term.needed(record, name)[:, j] for name in ("pressure_a", "pressure_b")]
    areas = (1.0, 1.0)
    if setting.machine is not None:
        cylinder = cylinder_machine(term, setting, joint).cylinders[joint]
        areas = cylinder.area_a, cylinder.area_b
    return lever(setting, joint, record)[:, np.newaxis] * np.stack(pressures, axis=1) * areas


def _listed(machine: Machine) -> str:
    return ", ".join(machine.cylinders) or "none"


def gain_unit(setting: Setting, joint: str) -> str:
    """Unit of a parameter that multiplies `chamber_forces`."""
    return "1" if setting.machine is not None else f"{setting.force_unit(joint)}/Pa"
