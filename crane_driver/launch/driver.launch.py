"""The driver on a CAN bus and, where a folder is given, a recorder."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "bus_interface": ("udp_multicast", "Interface of python-can, for example socketcan"),
    "bus_channel": ("", "Channel of the interface, for example can0; empty: its default"),
    "bus_options": ("", "Further options as KEY=VALUE, separated by blanks"),
    "dbc": ("", "DBC file; empty: that of the laboratory crane"),
    "mapping": ("", "Mapping YAML; empty: that of the laboratory crane"),
    "machine": ("", "Machine YAML; empty: the laboratory crane"),
    "safety": ("", "YAML of the safety functions; empty: that of the laboratory crane"),
    "record": ("", "New folder to record to; empty: nothing is recorded"),
}


def text(argument: str) -> ParameterValue:
    """A parameter that stays text, even where it looks like a number."""
    return ParameterValue(LaunchConfiguration(argument), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """The driver configures and activates itself; the valves stay neutral until it is enabled."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            Node(
                package="crane_driver",
                executable="driver",
                output="screen",
                parameters=[
                    {
                        "bus.interface": text("bus_interface"),
                        "bus.channel": text("bus_channel"),
                        "bus.options": text("bus_options"),
                        "dbc": text("dbc"),
                        "mapping": text("mapping"),
                        "machine": text("machine"),
                        "safety": text("safety"),
                    }
                ],
            ),
            Node(
                package="crane_driver",
                executable="recorder",
                output="screen",
                arguments=["--out", LaunchConfiguration("record")],
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("record"), "")),
            ),
        ]
    )
