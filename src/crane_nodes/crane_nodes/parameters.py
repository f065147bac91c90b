"""Parameters of a node, declared with any type and converted with errors that say what is wrong.

A file that says `lag: 1` gives ROS an integer, which a parameter declared as a double would refuse.
The range of a number stands with it alone: ROS, `--help` and the checks have it from there.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.errors import ConfigurationError
from crane_model.machine_files import DEFAULT_MACHINE

if TYPE_CHECKING:  # large, and the recorder needs no machine
    from crane_model.machine import Machine

Value = TypeVar("Value")


class _Checked(Generic[Value]):
    name: str
    meaning: str

    @property
    def description(self) -> str:
        """Text that `ros2 param describe` shows."""
        return self.meaning

    def read(self, node: Node) -> Value:
        """Value that the parameter has in `node`; `ConfigurationError` if `check` refuses it."""
        return self.check(node.get_parameter(self.name).value)

    def check(self, value: Any) -> Value:
        """`value` if it may be given for the parameter, else `ConfigurationError`."""
        raise NotImplementedError


@dataclass(frozen=True)
class _InRange(_Checked[Value]):
    name: str
    default: Value
    unit: str
    lowest: float
    highest: float
    meaning: str

    @property
    def description(self) -> str:
        return f"{self.meaning}. Unit: {self.unit}, range: [{self.lowest:g} - {self.highest:g}]"


@dataclass(frozen=True)
class Text(_Checked[str]):
    """A parameter that is a piece of text.

    Parameters
    ----------
    name, default, meaning
        Name and default value of the parameter, and what it means in a few words.

    Examples
    --------
    >>> Text("name", "", "of the crane").check("left")
    'left'
    """

    name: str
    default: str
    meaning: str

    def check(self, value: Any) -> str:
        if not isinstance(value, str):
            raise ConfigurationError(f"parameter '{self.name}': must be text, got {value!r}")
        return value


@dataclass(frozen=True)
class Switch(_Checked[bool]):
    """A parameter that is true or false.

    Parameters
    ----------
    name, default, meaning
        Name and default value of the parameter, and what it means in a few words.

    Examples
    --------
    >>> Switch("loud", False, "whether it is heard").check(True)
    True
    """

    name: str
    default: bool
    meaning: str

    def check(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ConfigurationError(
                f"parameter '{self.name}': must be true or false, got {value!r}"
            )
        return value


@dataclass(frozen=True)
class Number(_InRange[float]):
    """A parameter that is a number.

    Parameters
    ----------
    name, default
        Name and default value of the parameter.
    unit, lowest, highest
        Unit of the number, and its limits in this unit, which belong to the range.
    meaning
        What it means in a few words.
    whole
        Whether it must be a whole number.

    Examples
    --------
    >>> speed = Number("speed", 0.3, "m/s", 0.0, 1.0, "of the tip")
    >>> speed.check(1)
    1.0
    >>> speed.check(2.0)
    Traceback (most recent call last):
    ...
    crane_model.errors.ConfigurationError: parameter 'speed': must be from 0 to 1 m/s, got 2.0
    """

    whole: bool = False

    def check(self, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigurationError(f"parameter '{self.name}': must be a number, got {value!r}")
        if self.whole and not float(value).is_integer():
            raise ConfigurationError(f"parameter '{self.name}': must be whole, got {value}")
        if not math.isfinite(value) or not self.lowest <= value <= self.highest:
            raise ConfigurationError(
                f"parameter '{self.name}': must be from {self.lowest:g} to {self.highest:g} "
                f"{self.unit}, got {value}"
            )
        return float(value)


@dataclass(frozen=True)
class Numbers(_InRange[tuple[float, ...]]):
    """A parameter that is a list of numbers of one unit, each within the same limits.

    Parameters
    ----------
    name, default
        Name and default values of the parameter.
    unit, lowest, highest
        Unit of the numbers, and their limits in this unit, which belong to the range.
    meaning
        What they mean in a few words.

    Examples
    --------
    >>> Numbers("poses", (), "rad", -1.0, 1.0, "to be held").check([0, 0.5])
    (0.0, 0.5)
    """

    def check(self, value: Any) -> tuple[float, ...]:
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise ConfigurationError(
                f"parameter '{self.name}': must be a list of numbers, got {value!r}"
            )
        number = Number(self.name, 0.0, self.unit, self.lowest, self.highest, self.meaning)
        return tuple(number.check(entry) for entry in value)


NodeParameter = Text | Switch | Number | Numbers

MACHINE = Text(
    "machine",
    DEFAULT_MACHINE,
    "Name of a shipped machine, machine folder or machine file; its files are the defaults of "
    "other parameters. At the start",
)
"""A node reads it first, for other parameters are of the joints of the machine."""


def given(node: Node, parameters: Sequence[NodeParameter]) -> set[str]:
    """Names of parameters given at the start, even as the default; call before `declare`."""
    names = set()
    for parameter in parameters:
        without_default = ParameterDescriptor(dynamic_typing=True)
        declared = node.declare_parameter(parameter.name, descriptor=without_default)
        if declared.type_ is not Parameter.Type.NOT_SET:
            names.add(parameter.name)
        node.undeclare_parameter(parameter.name)
    return names


def declare(
    node: Node, parameters: Sequence[NodeParameter], read_only: Collection[NodeParameter] = ()
) -> None:
    """Declare parameters with their ranges, whatever the type of the values given for them.

    From then on, a value that `check` refuses cannot be set; a whole number for a `Number` becomes
    a double, as those who read it expect.

    Parameters
    ----------
    node
        Node that gets the parameters.
    parameters
        Parameters to declare.
    read_only
        Those that are read at the start alone, and cannot be set later.

    Raises
    ------
    ConfigurationError
        If `check` refuses a value that was given at the start.
    """
    for parameter in parameters:
        default = parameter.default
        node.declare_parameter(
            parameter.name,
            list(default) if isinstance(default, tuple) else default,
            ParameterDescriptor(dynamic_typing=True),
        )
        parameter.read(node)  # before ROS knows the range: its own error would be a traceback
        node.set_descriptor(parameter.name, _descriptor(parameter, parameter in read_only))
    known = {parameter.name: parameter for parameter in parameters}

    def checked(values: Sequence[Parameter]) -> SetParametersResult:
        try:
            for value in values:
                if value.name in known:
                    known[value.name].check(value.value)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def converted(values: list[Parameter]) -> list[Parameter]:
        return [_as_double(value) if value.name in doubles else value for value in values]

    doubles = {
        parameter.name
        for parameter in parameters
        if isinstance(parameter, Number) and not parameter.whole
    }
    node.add_pre_set_parameters_callback(converted)
    node.add_on_set_parameters_callback(checked)


def hold(node: Node, fixed: Sequence[NodeParameter], state: Callable[[], str]) -> None:
    """Refuse to change `fixed` parameters while the `state` of the node is not "unconfigured"."""
    names = {parameter.name for parameter in fixed}

    def held(values: Sequence[Parameter]) -> SetParametersResult:
        for value in values:
            if value.name not in names or state() == "unconfigured":
                continue
            if value.value != node.get_parameter(value.name).value:
                return SetParametersResult(
                    successful=False,
                    reason=f"parameter '{value.name}' is read when the node is configured, and the "
                    f"node is {state()}; deactivate it and clean it up first",
                )
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(held)


def declare_machine(node: Node) -> "Machine":
    """Declare the parameter and read the machine; `ConfigurationError` if there is none such."""
    from crane_model.machine import load_machine

    declare(node, (MACHINE,), read_only=(MACHINE,))
    return load_machine(MACHINE.read(node))


def read_machine_again(node: Node, machine: "Machine") -> "Machine":
    """The machine as its file is now; `ConfigurationError` if its joints are others than before."""
    from crane_model.machine import load_machine

    now = load_machine(MACHINE.read(node))
    if dict(now.units) != dict(machine.units):
        raise ConfigurationError(
            f"{now.name}: the joints were {', '.join(machine.joint_names)} when the node started, "
            f"now they are {', '.join(now.joint_names)}; start the node again"
        )
    return now


def _descriptor(parameter: NodeParameter, read_only: bool) -> ParameterDescriptor:
    """Description for `ros2 param describe` and tools that draw sliders."""
    descriptor = ParameterDescriptor(
        description=parameter.description, dynamic_typing=True, read_only=read_only
    )
    match parameter:
        case Number(whole=True):
            whole = IntegerRange(
                from_value=int(parameter.lowest), to_value=int(parameter.highest), step=1
            )
            descriptor.integer_range = [whole]
        case Number() | Numbers():
            real = FloatingPointRange(
                from_value=float(parameter.lowest), to_value=float(parameter.highest)
            )
            descriptor.floating_point_range = [real]
    return descriptor


def _as_double(given: Parameter) -> Parameter:
    if given.type_ is not Parameter.Type.INTEGER:
        return given
    return Parameter(given.name, value=float(given.value))
