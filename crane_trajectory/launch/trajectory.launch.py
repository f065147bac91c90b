"""The trajectory node, which waits for goals of the action RunExcitation."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "machine": ("", "Machine YAML with the limits; empty: the laboratory crane"),
    "clearance": ("", "File of the room that the boom tip keeps; empty: packaged"),
    "controller": ("", "File of the gains, as bring-up writes it; empty: packaged"),
}


def text(argument: str) -> ParameterValue:
    """A parameter that stays text, even where it looks like a number."""
    return ParameterValue(LaunchConfiguration(argument), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """The node configures and activates itself; nothing moves before a goal is sent."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            Node(
                package="crane_trajectory",
                executable="trajectory",
                output="screen",
                parameters=[
                    {
                        "machine": text("machine"),
                        "clearance": text("clearance"),
                        "controller": text("controller"),
                    }
                ],
            ),
        ]
    )
