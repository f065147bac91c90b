"""Topics of the suite and the message types that bags of them hold; needs no running ROS."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from crane_model.errors import CraneError

INTERFACES = "crane_interfaces"
DEFINITIONS = Path(__file__).with_name("msg")
"""Folder of the .msg files of crane_interfaces: a link to it, and in a wheel a copy."""


@dataclass(frozen=True)
class Topic:
    """A topic as it is recorded.

    Parameters
    ----------
    name
        Of a crane in the root namespace.
    msgtype
        For example sensor_msgs/msg/JointState.
    latched
        Whether its publisher keeps the last message for late joiners.
    continuous
        Whether its publisher sends without pause as long as it is there.
    """

    name: str  # of a crane in the root namespace
    msgtype: str
    latched: bool = False
    continuous: bool = False

    @property
    def relative(self) -> str:
        """Name relative to the node's namespace; all nodes of a domain share /diagnostics."""
        return self.name if self.name == "/diagnostics" else self.name.removeprefix("/")

    def within(self, namespace: str) -> "Topic":
        """That of the crane in a namespace: `/left`, or `/`."""
        return replace(self, name=f"{namespace.rstrip('/')}{self.name}")


JOINT_STATES = Topic("/joint_states", "sensor_msgs/msg/JointState", continuous=True)
CYLINDER_PRESSURES = Topic(
    "/cylinder_pressures", f"{INTERFACES}/msg/CylinderPressures", continuous=True
)
VALVE_COMMAND = Topic("/valve_command", f"{INTERFACES}/msg/ValveCommand")
VALVE_OUTPUT = Topic("/valve_output", f"{INTERFACES}/msg/ValveCommand")
JOINT_REFERENCE = Topic("/joint_reference", f"{INTERFACES}/msg/JointReference")
PARAMETER_ESTIMATE = Topic(
    "/parameter_estimate", f"{INTERFACES}/msg/ParameterEstimate", latched=True
)
GENERALIZED_FORCES = Topic("/generalized_forces", f"{INTERFACES}/msg/GeneralizedForces")
DRIVER_STATE = Topic("/driver/state", f"{INTERFACES}/msg/DriverState", latched=True)
SENSOR_FINDINGS = Topic("/sensor_findings", f"{INTERFACES}/msg/SensorFindings", latched=True)
POSITION_ESTIMATE = Topic("/position_estimate", f"{INTERFACES}/msg/PositionEstimate")
TIP_LOAD = Topic("/tip_load", f"{INTERFACES}/msg/TipLoad", latched=True)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", continuous=True)
ROBOT_DESCRIPTION = Topic("/robot_description", "std_msgs/msg/String", latched=True)
TOPICS = (
    *(JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE),
    *(VALVE_OUTPUT, PARAMETER_ESTIMATE, GENERALIZED_FORCES, DIAGNOSTICS, ROBOT_DESCRIPTION),
    *(DRIVER_STATE, SENSOR_FINDINGS, POSITION_ESTIMATE, TIP_LOAD),
)
"""All that the nodes of the suite publish, reliably; /joint_states_estimated has nothing that
/position_estimate has not."""


CAN_FRAMES = {
    "can_msgs/msg/Frame": """
        std_msgs/Header header
        uint32 id
        bool is_rtr
        bool is_extended
        bool is_error
        uint8 dlc
        uint8[8] data
    """,
    "ros2_socketcan_msgs/msg/FdFrame": """
        std_msgs/Header header
        uint32 id
        bool is_extended
        bool is_error
        uint8 len
        uint8[<=64] data
    """,
}
"""Types of what ros2_socketcan records of a CAN bus, with their definitions."""


@cache
def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy, of crane_interfaces and of CAN frames.

    Raises
    ------
    CraneError
        If the definitions of crane_interfaces did not come with this package.
    """
    definitions = sorted(DEFINITIONS.glob("*.msg"))
    if not definitions:
        raise CraneError(
            f"{DEFINITIONS}: no .msg files; this is a link to crane_interfaces/msg: clone the "
            "repository with its links, or install crane_driver again"
        )
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in definitions:
        types |= get_types_from_msg(path.read_text("utf-8"), f"{INTERFACES}/msg/{path.stem}")
    for name, definition in CAN_FRAMES.items():
        types |= get_types_from_msg(definition, name)
    store.register(types)
    return store


def double_fields(store: Typestore, msgtype: str) -> dict[str, bool]:
    """The float64 (False) and float64[] (True) fields of a message type, in their order."""
    fields: dict[str, bool] = {}
    for name, description in store.fielddefs[msgtype][1]:
        if description == (Nodetype.BASE, ("float64", 0)):
            fields[name] = False
        elif description == (Nodetype.SEQUENCE, ((Nodetype.BASE, ("float64", 0)), 0)):
            fields[name] = True
    return fields
