"""The nodes as they are before they are configured: parameters, topics, services."""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from crane_driver.driver_node import Driver
from crane_driver.operator.jog.jog_node import Jog
from crane_driver.operator.panel.panel_node import OperatorPanel
from crane_identification.online.identification_node import Identification
from crane_model import load_machine
from crane_nodes.this_computer import DISCOVERY_RANGE, PROFILES
from crane_observer.node.payload_estimator_node import PayloadEstimatorNode
from crane_observer.node.position_estimator_node import PositionEstimatorNode
from crane_observer.node.sensor_monitor_node import SensorMonitorNode
from crane_trajectory.trajectory_node import Trajectory

NODES: dict[str, Callable[[], Node]] = {
    "driver": Driver,
    "trajectory": Trajectory,
    "identification": Identification,
    "position_estimator": PositionEstimatorNode,
    "payload_estimator": PayloadEstimatorNode,
    "sensor_monitor": SensorMonitorNode,
    "jog": lambda: Jog(by_joystick=True),
    "panel": OperatorPanel,
}
OF_EVERY_NODE = {"use_sim_time", "start_type_description_service"}
JOINT = re.compile(rf"\b({'|'.join(load_machine().joint_names)})\b")
UNIT = re.compile(r"(?<=Unit: )[^,]+(?=,)")
INTRODUCTION = """# Parameters

Parameters marked *At configure* take effect when the node is configured: `deactivate`, `cleanup`,
set, `configure`, `activate`. *Empty* stands for `''`. Several values belong to the joints of the
laboratory crane, from the base to the tip.
"""


def keep_apart() -> None:
    """From now on, nodes of this process see no others."""
    os.environ[DISCOVERY_RANGE] = "OFF"
    os.environ.pop(PROFILES, None)  # it has peers


@contextmanager
def unconfigured(name: str, *arguments: str, domain: int | None = None) -> Iterator[Node]:
    """One of NODES as it stands before it is configured, with ROS arguments where there are any."""
    rclpy.init(args=[name, *arguments], domain_id=domain)
    try:
        node = NODES[name]()
        yield node
        node.destroy_node()
    finally:
        rclpy.shutdown()


def pages() -> dict[str, str]:
    """The parameters of all nodes."""
    keep_apart()
    parts = [INTRODUCTION]
    for name in NODES:
        with unconfigured(name) as node:
            parts.append(f"## {name}\n\n{parameters(node)}")
    return {"parameters.md": "\n".join(parts)}


def parameters(node: Node) -> str:
    """A table; parameters that differ by joint and unit alone share a row."""
    rows: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in node.get_parameters_by_prefix(""):
        if name not in OF_EVERY_NODE:
            parameter = node.get_parameter(name)
            description = node.describe_parameter(name).description
            units = UNIT.findall(description)
            row = (JOINT.sub("JOINT", name), UNIT.sub("{unit}", JOINT.sub("JOINT", description)))
            rows.setdefault(row, []).append((_shown(parameter.value), *(units or [""])))
    lines = ["| parameter | default | meaning |", "|---|---|---|"]
    for (name, meaning), entries in rows.items():
        defaults = [default for default, _ in entries]
        default = defaults[0] if len(_unique(defaults)) == 1 else ", ".join(defaults)
        meaning = meaning.replace("{unit}", " or ".join(_unique(unit for _, unit in entries)))
        lines.append(f"| `{name}` | {default} | {meaning} |")
    return "\n".join(lines) + "\n"


def services(node: Node) -> list[str]:
    """The names of its own services, without that of the node."""
    return [one.srv_name.rpartition("/")[2] for one in node.services if one.srv_type is Trigger]


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value or "empty"
    if isinstance(value, float | int):
        return f"{value:g}"
    assert hasattr(value, "__iter__")
    return ", ".join(f"{one:g}" for one in value) or "empty"


def _unique(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))
