"""The whole suite with the simulated crane: driver, recorder, trajectory, identification."""

from launch import LaunchDescription

from crane_nodes.launching import COMMON, declared, included

CRANE = {
    "bus_interface": "Interface of python-can; by default udp_multicast, which stays on this host",
    "bus_channel": "Channel of the interface, for example vcan0",
    "bus_bitrate": "Bit rate [bit/s], for interfaces that set it",
    "bus_options": "Further options as KEY=VALUE, separated by blanks: port=43113",
    "machine": "Machine: name, folder or machine file",
    "record": "New folder to record to; empty: nothing is recorded",
    "tf": "true: robot_state_publisher gives the frames of all links",
}
MODEL = {"model": "Model file to identify", "model_output": "File that ~/save_model writes"}
ARGUMENTS = COMMON | CRANE | MODEL


def generate_launch_description() -> LaunchDescription:
    """Everything starts; the crane moves when it is enabled and a goal is sent."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            included("crane_sim", "simulated_crane.launch.py", *CRANE),
            included("crane_trajectory", "trajectory.launch.py", "machine"),
            included("crane_identification", "identification.launch.py", "machine", *MODEL),
        ]
    )
