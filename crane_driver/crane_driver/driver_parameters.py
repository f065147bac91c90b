"""The parameters of the driver: declared with unit and range, read with errors that name them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node

from crane_driver.can.bus import BusSettings, bus_settings
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_nodes.managed import AUTOSTART
from crane_nodes.parameters import MACHINE, NodeParameter, Number, Switch, Text
from crane_nodes.this_computer import RealTimeSettings

INTERFACE = Text(
    "bus.interface", "udp_multicast", "Interface of python-can, for example socketcan. At configure"
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
DBC = Text("dbc", "", "DBC file; empty: can.dbc of the machine. At configure")
MAPPING = Text(
    "mapping",
    "",
    "Mapping file of the signals (YAML); empty: can.yaml of the machine. At configure",
)
SAFETY = Text("safety", "", "Safety file (YAML); empty: safety.yaml of the machine. At configure")
LISTEN_ONLY = Switch(
    "listen_only",
    False,
    "Send nothing on the bus: publish what is read, and on valve_output what others command. The "
    "mapping then needs no commands. At configure",
)
PRIORITY = Number(
    "realtime.priority",
    50,
    "-",
    0,
    99,
    "Real-time priority (SCHED_FIFO), if the system permits it; 0: none. At configure",
    whole=True,
)
LOCK_MEMORY = Switch(
    "realtime.lock_memory",
    True,
    "Keep the memory of the driver from being paged out, if the system permits it. At configure",
)
LISTENERS = Text(
    "simulated_time.listeners",
    "",
    "With use_sim_time: nodes, "
    "separated by blanks, that must hear joint_states before time advances; while the crane rests "
    "without commands, time stops. Empty: time always advances. At configure",
)


def jerk_density_parameters(machine: Machine, name: str) -> dict[str, Number]:
    """By joint of the machine called `name`; `ConfigurationError` if its joints.yaml is wrong."""
    notes = load_joint_notes(machine_file("joints.yaml", name), machine.units)
    return {
        joint: Number(
            f"jerk_density.{joint}",
            note.jerk_density,
            f"{machine.units[joint]}^2/s^5",
            1e-9,
            1e6,
            "Expected jerk squared times its duration, for the velocity. At configure",
        )
        for joint, note in notes.items()
    }


def driver_parameters(machine: Machine, name: str) -> tuple[NodeParameter, ...]:
    """All parameters of the driver of the machine called `name`, `MACHINE` first."""
    return (
        *(
            MACHINE,
            AUTOSTART,
            INTERFACE,
            CHANNEL,
            BITRATE,
            OPTIONS,
            DBC,
            MAPPING,
            SAFETY,
            LISTEN_ONLY,
        ),
        *jerk_density_parameters(machine, name).values(),
        *(PRIORITY, LOCK_MEMORY, LISTENERS),
    )


@dataclass(frozen=True)
class DriverParameters:
    """The parameters as the driver uses them."""

    bus: BusSettings
    dbc: Path
    mapping: Path
    safety: Path
    jerk_density: Mapping[str, float]
    realtime: RealTimeSettings
    listeners: Sequence[str]
    listen_only: bool


def read_parameters(node: Node, machine: Machine) -> DriverParameters:
    """`ConfigurationError` names the parameter, what it must be and its value."""
    name = MACHINE.read(node)
    densities = jerk_density_parameters(machine, name)
    return DriverParameters(
        bus=bus_settings(
            INTERFACE.read(node),
            CHANNEL.read(node),
            int(BITRATE.read(node)),
            OPTIONS.read(node).split(),
        ),
        dbc=machine_file("can.dbc", name, DBC.read(node)),
        mapping=machine_file("can.yaml", name, MAPPING.read(node)),
        safety=machine_file("safety.yaml", name, SAFETY.read(node)),
        jerk_density={joint: parameter.read(node) for joint, parameter in densities.items()},
        realtime=RealTimeSettings(int(PRIORITY.read(node)), LOCK_MEMORY.read(node)),
        listeners=LISTENERS.read(node).split(),
        listen_only=LISTEN_ONLY.read(node),
    )
