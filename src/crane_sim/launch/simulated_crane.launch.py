"""The simulated crane on a CAN bus, and the driver on the same bus."""

from launch import LaunchContext, LaunchDescription
from launch.actions import ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import ExecutableInPackage

from crane_nodes.launching import COMMON, declared, included

OF_MACHINE = {
    "bus_interface": "Interface of python-can; by default udp_multicast, which stays on this host",
    "bus_channel": "Channel of the interface, for example vcan0",
    "bus_bitrate": "Bit rate [bit/s], for interfaces that set it",
    "bus_options": "Further options as KEY=VALUE, separated by blanks: port=43113",
    "machine": "Machine: name, folder or machine file",
}
OF_DRIVER = {
    "record": "New folder to record to; empty: nothing is recorded",
    "tf": "true: robot_state_publisher gives the frames of all links",
}
ARGUMENTS = COMMON | OF_MACHINE | OF_DRIVER
OPTIONS = {
    "bus_interface": "--interface",
    "bus_channel": "--channel",
    "bus_bitrate": "--bitrate",
    "machine": "--machine",
}


def simulated_crane(context: LaunchContext) -> list[ExecuteProcess]:
    """The machine; it has no ROS, as a real one has none, and so is no node."""

    def given(argument: str) -> str:
        return LaunchConfiguration(argument).perform(context)

    options = [(option, given(name)) for name, option in OPTIONS.items() if given(name)]
    options += [("--bus-option", option) for option in given("bus_options").split()]
    return [
        ExecuteProcess(
            cmd=[
                ExecutableInPackage(package="crane_sim", executable="simulated_crane"),
                *(word for pair in options for word in pair),
            ],
            name="simulated_crane",
            output="screen",
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Machine and driver; the valves stay neutral until the driver is enabled."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            OpaqueFunction(function=simulated_crane),
            included("crane_driver", "driver.launch.py", *OF_MACHINE, *OF_DRIVER),
        ]
    )
