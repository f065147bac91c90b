"""The parameter that names the machine: a node reads it first, for others are of its joints."""

from rclpy.node import Node

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import DEFAULT_MACHINE
from crane_nodes.parameters import Text, declare

MACHINE = Text(
    "machine",
    DEFAULT_MACHINE,
    "Machine that ships with the suite by its name, or the folder or machine file of another; its "
    "files are those that are not named themselves. At the start",
)


def declare_machine(node: Node) -> Machine:
    """Declare the parameter and read the machine; `ConfigurationError` if there is none such."""
    declare(node, (MACHINE,), read_only=(MACHINE,))
    return load_machine(MACHINE.read(node))


def read_again(node: Node, machine: Machine) -> Machine:
    """The machine as its file is now; `ConfigurationError` if its joints are others than before."""
    now = load_machine(MACHINE.read(node))
    if dict(now.units) != dict(machine.units):
        raise ConfigurationError(
            f"{now.name}: the joints were {', '.join(machine.joint_names)} when the node started, "
            f"now they are {', '.join(now.joint_names)}; start the node again"
        )
    return now
