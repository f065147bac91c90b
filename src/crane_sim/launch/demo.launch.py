"""The whole suite beside the stand-in machine: driver, recorder, trajectory, identification."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "bus_interface": ("udp_multicast", "Interface of python-can; udp_multicast stays on this host"),
    "bus_channel": ("", "Channel of the interface, for example vcan0; empty: its default"),
    "bus_options": ("", "Further options as KEY=VALUE, separated by blanks: port=43113"),
    "machine": ("", "Machine YAML; empty: the laboratory crane"),
    "record": ("", "New folder to record to; empty: nothing is recorded"),
    "model": ("", "Model file to identify; empty: the model that ships with the suite"),
    "model_output": ("identified_model.yaml", "File that ~/save_model writes"),
}
CRANE = ("bus_interface", "bus_channel", "bus_options", "machine", "record")


def included(package: str, file: str, *arguments: str) -> IncludeLaunchDescription:
    """Another launch file, and the arguments that are handed on to it."""
    path = PathJoinSubstitution([FindPackageShare(package), "launch", file])
    values = [(name, LaunchConfiguration(name)) for name in arguments]
    return IncludeLaunchDescription(path, launch_arguments=values)


def generate_launch_description() -> LaunchDescription:
    """Everything starts; the crane moves when it is enabled and a goal is sent."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            included("crane_sim", "simulated_crane.launch.py", *CRANE),
            included("crane_trajectory", "trajectory.launch.py", "machine"),
            included("crane_identification", "identification.launch.py", "model", "model_output"),
        ]
    )
