"""Terms that act on one joint at one instant."""

from abc import abstractmethod
from typing import ClassVar

from crane_model.array import Array
from crane_model.errors import ConfigurationError
from crane_model.motion_columns import MotionColumn, MotionQuantity, fill
from crane_model.record import Record
from crane_model.terms.term import Parameter, Setting, Term


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
