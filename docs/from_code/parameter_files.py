"""A parameter file for every node, ready to copy; `make figures` writes them.

Each holds what the node declares, with the defaults. Commented out is what has none in the node:
empty lists, which ROS cannot write, and what the files of a machine say joint by joint.
"""

from pathlib import Path

import yaml
from rclpy.node import Node

from from_code.nodes import JOINT, NODES, OF_EVERY_NODE, keep_apart, unconfigured

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "driver": "crane_driver",
    "trajectory": "crane_trajectory",
    "identification": "crane_identification",
    "position_estimator": "src/crane_observer",
    "payload_estimator": "src/crane_observer",
    "sensor_monitor": "src/crane_observer",
    "jog": "crane_driver",
    "panel": "crane_driver",
}
HEAD = """# Parameters of the node {name}, with their defaults: copy it, keep what you change.
#
#   ros2 run {package} {name} --ros-args --params-file {name}.yaml
#
# Unless you set them here, commented parameters come from the files of the machine or from topics.

/**/{name}:
  ros__parameters:
"""


def place(name: str) -> Path:
    """Of the file of a node."""
    return ROOT / PACKAGES[name] / "config" / f"{name}.yaml"


def rendered(name: str, node: Node) -> str:
    """The file of a node as it stands before it is configured."""
    lines = [HEAD.format(name=name, package=Path(PACKAGES[name]).name)]
    for parameter in sorted(node.get_parameters_by_prefix("")):
        if parameter in OF_EVERY_NODE:
            continue
        value = node.get_parameter(parameter).value
        if not isinstance(value, bool | int | float | str):
            value = list(value)
        text = yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()
        elsewhere = JOINT.search(parameter) or value == []
        lines += [
            f"    # {node.describe_parameter(parameter).description}\n",
            f"    {'# ' if elsewhere else ''}{parameter}: {text}\n",
        ]
    return "".join(lines)


def main() -> None:
    """Write them all."""
    keep_apart()
    for name in NODES:
        place(name).parent.mkdir(exist_ok=True)
        with unconfigured(name) as node:
            place(name).write_text(rendered(name, node), "utf-8")


if __name__ == "__main__":
    main()
