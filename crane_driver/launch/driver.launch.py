"""The driver on a CAN bus and, where a folder is given, a recorder."""

from launch import LaunchDescription
from launch.substitutions import LaunchConfiguration

from crane_nodes.launching import COMMON, declared, node

ARGUMENTS = COMMON | {
    "bus_interface": "Interface of python-can, for example socketcan",
    "bus_channel": "Channel of the interface, for example can0",
    "bus_bitrate": "Bit rate [bit/s], for interfaces that set it",
    "bus_options": "Further options as KEY=VALUE, separated by blanks",
    "dbc": "DBC file",
    "mapping": "Mapping YAML",
    "machine": "Machine: name, folder or machine file",
    "safety": "Safety file (YAML)",
    "record": "New folder to record to; empty: nothing is recorded",
    "tf": "true: robot_state_publisher gives the frames of all links",
}


def generate_launch_description() -> LaunchDescription:
    """The driver configures and activates itself; the valves stay neutral until it is enabled."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            node(
                package="crane_driver",
                executable="driver",
                parameters={
                    "bus.interface": ("bus_interface", str),
                    "bus.channel": ("bus_channel", str),
                    "bus.bitrate": ("bus_bitrate", int),
                    "bus.options": ("bus_options", str),
                    "dbc": ("dbc", str),
                    "mapping": ("mapping", str),
                    "machine": ("machine", str),
                    "safety": ("safety", str),
                },
            ),
            node(
                package="crane_nodes",
                executable="recorder",
                arguments=("--out", LaunchConfiguration("record")),
                only_with="record",
            ),
            node(package="crane_nodes", executable="robot_state_publisher", only_with="tf"),
        ]
    )
