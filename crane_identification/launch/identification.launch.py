"""The identification node and, where a bag is given, a player in the place of the crane."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "model": ("", "Model file to identify; empty: the model that ships with the suite"),
    "model_output": ("identified_model.yaml", "File that ~/save_model writes"),
    "forgetting": ("1.0", "Forgetting factor per row"),
    "use_sim_time": ("false", "Take the time from /clock, for diagnostics beside a player"),
    "play": ("", "Bag to play; empty: the topics come from elsewhere"),
}


def value(argument: str, kind: type) -> ParameterValue:
    """A parameter of one type, whatever it looks like."""
    return ParameterValue(LaunchConfiguration(argument), value_type=kind)


def generate_launch_description() -> LaunchDescription:
    """The node configures and activates itself; the player waits until it listens."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            Node(
                package="crane_identification",
                executable="identification",
                output="screen",
                parameters=[
                    {
                        "model": value("model", str),
                        "model_output": value("model_output", str),
                        "forgetting": value("forgetting", float),
                        "use_sim_time": value("use_sim_time", bool),
                    }
                ],
            ),
            Node(
                package="crane_driver",
                executable="player",
                output="screen",
                arguments=[
                    LaunchConfiguration("play"),
                    *("--topics", "/joint_states", "/cylinder_pressures"),
                    *("--wait-for", "/joint_states", "/cylinder_pressures"),
                ],
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("play"), "")),
            ),
        ]
    )
