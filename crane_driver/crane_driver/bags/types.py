"""Topics of the suite and the message types that bags of them hold; needs no running ROS."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_path
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from crane_model.errors import CraneError

INTERFACES = "crane_interfaces"


@dataclass(frozen=True)
class Topic:
    """A topic as it is recorded; `latched` publishers keep the last message for late joiners."""

    name: str
    msgtype: str
    latched: bool = False


JOINT_STATES = Topic("/joint_states", "sensor_msgs/msg/JointState")
CYLINDER_PRESSURES = Topic("/cylinder_pressures", f"{INTERFACES}/msg/CylinderPressures")
VALVE_COMMAND = Topic("/valve_command", f"{INTERFACES}/msg/ValveCommand")
JOINT_REFERENCE = Topic("/joint_reference", f"{INTERFACES}/msg/JointReference")
PARAMETER_ESTIMATE = Topic(
    "/parameter_estimate", f"{INTERFACES}/msg/ParameterEstimate", latched=True
)
GENERALIZED_FORCES = Topic("/generalized_forces", f"{INTERFACES}/msg/GeneralizedForces")
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
ROBOT_DESCRIPTION = Topic("/robot_description", "std_msgs/msg/String", latched=True)
TOPICS = (
    *(JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE),
    *(PARAMETER_ESTIMATE, GENERALIZED_FORCES, DIAGNOSTICS, ROBOT_DESCRIPTION),
)
"""All that the nodes of the suite publish; reliably."""


def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy and of crane_interfaces as installed (ament index).

    `CraneError` if crane_interfaces is not in a prefix of AMENT_PREFIX_PATH.
    """
    try:
        share = get_package_share_path(INTERFACES, print_warning=False)
    except (PackageNotFoundError, OSError) as error:
        raise CraneError(
            f"{INTERFACES} is not installed: {error.args[0]}; build the workspace and source its "
            "environment file"
        ) from None
    return _typestore(share)


@cache
def _typestore(share: Path) -> Typestore:
    definitions = sorted((share / "msg").glob("*.msg"))
    if not definitions:
        raise CraneError(f"{share / 'msg'}: no .msg files; build {INTERFACES} again")
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in definitions:
        types |= get_types_from_msg(path.read_text("utf-8"), f"{INTERFACES}/msg/{path.stem}")
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
