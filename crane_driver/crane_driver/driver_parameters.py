"""The parameters of the driver: declared with unit and range, read with errors that name them."""

from collections.abc import Mapping
from dataclasses import dataclass

from rclpy.node import Node

from crane_driver.can.bus import BusSettings
from crane_driver.can.options import bus_settings
from crane_driver.realtime import RealTimeSettings
from crane_model.machine import JOINT_UNITS, JOINTS
from crane_nodes.managed import AUTOSTART
from crane_nodes.parameters import NodeParameter, Number, Switch, Text

INTERFACE = Text(
    "bus.interface",
    "udp_multicast",
    "Interface of python-can, for example socketcan. At configure",
)
CHANNEL = Text(
    "bus.channel",
    "",
    "Channel of the interface, for example can0; empty: its default. At configure",
)
BITRATE = Number(
    "bus.bitrate", 0, "bit/s", 0, 1_000_000, "Bit rate; 0: as it is set. At configure", whole=True
)
OPTIONS = Text(
    "bus.options",
    "",
    "Further options of the interface as KEY=VALUE, separated by blanks, for example port=43113. "
    "At configure",
)
DBC = Text("dbc", "", "DBC file; empty: that of the laboratory crane. At configure")
MAPPING = Text(
    "mapping",
    "",
    "YAML that says what the signals mean; empty: that of the laboratory crane. At configure",
)
MACHINE = Text(
    "machine", "", "Machine YAML with Tables 1 and 2; empty: the laboratory crane. At configure"
)
SAFETY = Text(
    "safety",
    "",
    "YAML of the safety functions; empty: that of the laboratory crane. At configure",
)
JERK_DENSITY = {
    joint: Number(
        f"jerk_density.{joint}",
        density,
        f"{JOINT_UNITS[joint]}^2/s^5",
        1e-9,
        1e6,
        "Expected jerk squared times its duration, for the velocity. At configure",
    )
    for joint, density in zip(JOINTS, (0.01, 0.01, 0.02, 0.05), strict=True)
}
PRIORITY = Number(
    "realtime.priority",
    50,
    "-",
    0,
    99,
    "Real-time priority (SCHED_FIFO), where the system permits it; 0: none. At configure",
    whole=True,
)
LOCK_MEMORY = Switch(
    "realtime.lock_memory",
    True,
    "Keep the memory of the driver from being paged out, where the system permits it. At configure",
)
PARAMETERS: tuple[NodeParameter, ...] = (
    *(AUTOSTART, INTERFACE, CHANNEL, BITRATE, OPTIONS, DBC, MAPPING, MACHINE, SAFETY),
    *JERK_DENSITY.values(),
    *(PRIORITY, LOCK_MEMORY),
)


@dataclass(frozen=True)
class DriverParameters:
    """The parameters as the driver uses them."""

    bus: BusSettings
    dbc: str | None
    mapping: str | None
    machine: str | None
    safety: str | None
    jerk_density: Mapping[str, float]
    realtime: RealTimeSettings


def read_parameters(node: Node) -> DriverParameters:
    """`ConfigurationError` names the parameter, what it must be and its value."""
    return DriverParameters(
        bus=bus_settings(
            INTERFACE.read(node),
            CHANNEL.read(node),
            int(BITRATE.read(node)),
            OPTIONS.read(node).split(),
        ),
        dbc=DBC.read(node) or None,
        mapping=MAPPING.read(node) or None,
        machine=MACHINE.read(node) or None,
        safety=SAFETY.read(node) or None,
        jerk_density={joint: one.read(node) for joint, one in JERK_DENSITY.items()},
        realtime=RealTimeSettings(int(PRIORITY.read(node)), LOCK_MEMORY.read(node)),
    )
