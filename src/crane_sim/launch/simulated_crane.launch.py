"""The stand-in machine on a CAN bus, and the driver on the same bus."""

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

ARGUMENTS = {
    "bus_interface": ("udp_multicast", "Interface of python-can; udp_multicast stays on this host"),
    "bus_channel": ("", "Channel of the interface, for example vcan0; empty: its default"),
    "bus_options": ("", "Further options as KEY=VALUE, separated by blanks: port=43113"),
    "machine": ("", "Machine YAML; empty: the laboratory crane"),
    "record": ("", "New folder to record to; empty: nothing is recorded"),
}
HANDED_ON = {name: LaunchConfiguration(name) for name in ARGUMENTS}


def simulated_crane(context: LaunchContext) -> list[ExecuteProcess]:
    """The machine; it has no ROS, as a real one has none, and so is no node."""
    options = LaunchConfiguration("bus_options").perform(context).split()
    machine = LaunchConfiguration("machine").perform(context)
    return [
        ExecuteProcess(
            cmd=[
                ExecutableInPackage(package="crane_sim", executable="simulated_crane"),
                *("--interface", LaunchConfiguration("bus_interface")),
                *("--channel", LaunchConfiguration("bus_channel")),
                *(word for option in options for word in ("--bus-option", option)),
                *(("--machine", machine) if machine else ()),
            ],
            name="simulated_crane",
            output="screen",
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Machine and driver; the valves stay neutral until the driver is enabled."""
    driver = PathJoinSubstitution([FindPackageShare("crane_driver"), "launch", "driver.launch.py"])
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=simulated_crane),
            IncludeLaunchDescription(driver, launch_arguments=HANDED_ON.items()),
        ]
    )
