"""The parameters of the driver: declared with unit and range, read with errors that name them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from crane_driver.can.bus import BusSettings
from crane_driver.can.options import bus_settings
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS

JERK_DENSITY = {"slew": 0.01, "inner_boom": 0.01, "outer_boom": 0.02, "telescope": 0.05}

PARAMETERS: dict[str, tuple[Any, str]] = {
    "autostart": (True, "Configure and activate at once. Unit: none, range: [true, false]"),
    "bus.interface": (
        "udp_multicast",
        "Interface of python-can. Unit: none, range: [udp_multicast, socketcan, ...]",
    ),
    "bus.channel": (
        "",
        "Channel of the interface, for example can0. Unit: none, range: any; empty: its default",
    ),
    "bus.bitrate": (0, "Bit rate. Unit: bit/s, range: [0 - 1000000]; 0: as it is set"),
    "bus.options": (
        "",
        "Further options of the interface as KEY=VALUE, separated by blanks, for example "
        "port=43113. Unit: none, range: any",
    ),
    "dbc": ("", "DBC file. Unit: none, range: path; empty: that of the laboratory crane"),
    "mapping": (
        "",
        "Mapping YAML, what the signals mean. Unit: none, range: path; empty: that of the "
        "laboratory crane",
    ),
    "machine": (
        "",
        "Machine YAML with Table 1 and 2. Unit: none, range: path; empty: the laboratory crane",
    ),
    "safety": (
        "",
        "YAML of the safety functions. Unit: none, range: path; empty: that of the laboratory "
        "crane",
    ),
    **{
        f"jerk_density.{joint}": (
            density,
            "Expected jerk squared times its duration, for the velocity. Unit: "
            f"{'m' if joint == 'telescope' else 'rad'}^2/s^5, range: (0 - inf)",
        )
        for joint, density in JERK_DENSITY.items()
    },
}
"""Name: default and description. All are read when the node is configured."""


@dataclass(frozen=True)
class DriverParameters:
    """The parameters as the driver uses them."""

    bus: BusSettings
    dbc: str | None
    mapping: str | None
    machine: str | None
    safety: str | None
    jerk_density: Mapping[str, float]


def declare_parameters(node: Node) -> None:
    """Declare all; with dynamic typing, so that 5 does for 5.0."""
    for name, (default, description) in PARAMETERS.items():
        descriptor = ParameterDescriptor(description=description, dynamic_typing=True)
        node.declare_parameter(name, default, descriptor)


def read_parameters(node: Node) -> DriverParameters:
    """`ConfigurationError` names the parameter, what it must be and its value."""
    return DriverParameters(
        bus=bus_settings(
            _text(node, "bus.interface"),
            _text(node, "bus.channel"),
            _bitrate(node),
            _text(node, "bus.options").split(),
        ),
        dbc=_text(node, "dbc") or None,
        mapping=_text(node, "mapping") or None,
        machine=_text(node, "machine") or None,
        safety=_text(node, "safety") or None,
        jerk_density={joint: _positive(node, f"jerk_density.{joint}") for joint in JOINTS},
    )


def _text(node: Node, name: str) -> str:
    value = node.get_parameter(name).value
    if not isinstance(value, str):
        raise _wrong(name, "text", value)
    return value


def _bitrate(node: Node) -> int:
    value = node.get_parameter("bus.bitrate").value
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 1_000_000:
        raise _wrong("bus.bitrate", "a whole number of bit/s from 0 to 1000000", value)
    return value


def _positive(node: Node, name: str) -> float:
    value = node.get_parameter(name).value
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 < value < 1e300:
        raise _wrong(name, "a positive number", value)
    return float(value)


def _wrong(name: str, wanted: str, value: object) -> ConfigurationError:
    return ConfigurationError(f"parameter '{name}': must be {wanted}, got {value!r}")
