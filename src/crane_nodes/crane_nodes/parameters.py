"""Parameters of a node, declared with any type and converted with errors that say what is wrong.

A file that says `lag: 1` gives ROS an integer, which a parameter declared as a double would refuse.
The range of a number stands with it alone: ROS, `--help` and the checks have it from there.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.errors import ConfigurationError


@dataclass(frozen=True)
class Text:
    """A parameter that is a piece of text."""

    name: str
    default: str
    meaning: str

    @property
    def description(self) -> str:
        """What `ros2 param describe` shows."""
        return self.meaning

    def read(self, node: Node) -> str:
        """The value; `ConfigurationError` if it is not text."""
        return self.check(node.get_parameter(self.name).value)

    def check(self, value: Any) -> str:
        """`value` if it may be given for the parameter, else `ConfigurationError`."""
        if not isinstance(value, str):
            raise ConfigurationError(f"parameter '{self.name}': must be text, got {value!r}")
        return value


@dataclass(frozen=True)
class Switch:
    """A parameter that is true or false."""

    name: str
    default: bool
    meaning: str

    @property
    def description(self) -> str:
        """What `ros2 param describe` shows."""
        return self.meaning

    def read(self, node: Node) -> bool:
        """The value; `ConfigurationError` if it is neither true nor false."""
        return self.check(node.get_parameter(self.name).value)

    def check(self, value: Any) -> bool:
        """`value` if it may be given for the parameter, else `ConfigurationError`."""
        if not isinstance(value, bool):
            raise ConfigurationError(
                f"parameter '{self.name}': must be true or false, got {value!r}"
            )
        return value


@dataclass(frozen=True)
class Number:
    """A parameter that is a number of a unit within [lowest, highest], a whole one if so said."""

    name: str
    default: float
    unit: str
    lowest: float
    highest: float
    meaning: str
    whole: bool = False

    @property
    def description(self) -> str:
        """What `ros2 param describe` shows."""
        return f"{self.meaning}. Unit: {self.unit}, range: [{self.lowest:g} - {self.highest:g}]"

    def read(self, node: Node) -> float:
        """The value; `ConfigurationError` if it is no number or out of range."""
        return self.check(node.get_parameter(self.name).value)

    def check(self, value: Any) -> float:
        """`value` if it may be given for the parameter, else `ConfigurationError`."""
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
class Numbers:
    """A parameter that is a list of numbers of a unit, each within [lowest, highest]."""

    name: str
    default: tuple[float, ...]
    unit: str
    lowest: float
    highest: float
    meaning: str

    @property
    def description(self) -> str:
        """What `ros2 param describe` shows."""
        return f"{self.meaning}. Unit: {self.unit}, range: [{self.lowest:g} - {self.highest:g}]"

    def read(self, node: Node) -> tuple[float, ...]:
        """The values; `ConfigurationError` if one is no number or out of range."""
        return self.check(node.get_parameter(self.name).value)

    def check(self, value: Any) -> tuple[float, ...]:
        """`value` if it may be given for the parameter, else `ConfigurationError`."""
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise ConfigurationError(
                f"parameter '{self.name}': must be a list of numbers, got {value!r}"
            )
        one = Number(self.name, 0.0, self.unit, self.lowest, self.highest, self.meaning)
        return tuple(one.check(entry) for entry in value)


NodeParameter = Text | Switch | Number | Numbers


def given(node: Node, parameters: Sequence[NodeParameter]) -> set[str]:
    """Names of those that were given at the start, by command line or launch file, even where the
    value is the default; to be asked before `declare`.
    """
    names = set()
    for parameter in parameters:
        without_default = ParameterDescriptor(dynamic_typing=True)
        one = node.declare_parameter(parameter.name, descriptor=without_default)
        if one.type_ is not Parameter.Type.NOT_SET:
            names.add(parameter.name)
        node.undeclare_parameter(parameter.name)
    return names


def declare(
    node: Node, parameters: Sequence[NodeParameter], read_only: Collection[NodeParameter] = ()
) -> None:
    """Declare all of them, whatever the type of what was given for them, with their ranges.

    `ConfigurationError` if `check` refuses what was given at the start. From then on, a value that
    it refuses cannot be set, nor one of `read_only`, which are read at the start alone; a whole
    number for a `Number` becomes a double, as those who read it expect.
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
            for one in values:
                if one.name in known:
                    known[one.name].check(one.value)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def converted(values: list[Parameter]) -> list[Parameter]:
        return [_as_double(one) if one.name in doubles else one for one in values]

    doubles = {one.name for one in parameters if isinstance(one, Number) and not one.whole}
    node.add_pre_set_parameters_callback(converted)
    node.add_on_set_parameters_callback(checked)


def _descriptor(parameter: NodeParameter, read_only: bool) -> ParameterDescriptor:
    """What `ros2 param describe` and tools that draw sliders are told."""
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


def hold(node: Node, fixed: Sequence[NodeParameter], state: Callable[[], str]) -> None:
    """Refuse to change what is read at configure unless `state` is "unconfigured"."""
    names = {parameter.name for parameter in fixed}

    def held(values: Sequence[Parameter]) -> SetParametersResult:
        for one in values:
            if one.name not in names or state() == "unconfigured":
                continue
            if one.value != node.get_parameter(one.name).value:
                return SetParametersResult(
                    successful=False,
                    reason=f"parameter '{one.name}' is read when the node is configured, and the "
                    f"node is {state()}; deactivate it and clean it up first",
                )
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(held)


def _as_double(given: Parameter) -> Parameter:
    if given.type_ is not Parameter.Type.INTEGER:
        return given
    return Parameter(given.name, value=float(given.value))
