"""The identification node and, where a bag is given, a player in the place of the crane."""

from launch import LaunchDescription
from launch.substitutions import LaunchConfiguration

from crane_nodes.launching import COMMON, declared, node

ARGUMENTS = COMMON | {
    "machine": "Machine: name, folder or machine file",
    "model": "Model file to identify",
    "model_output": "File that ~/save_model writes",
    "forgetting": "Forgetting factor per row",
    "use_sim_time": "Take the time from /clock, for diagnostics next to a player: true or false",
    "play": "Bag to play, recorded in the same namespace; empty: the topics come from elsewhere",
}
PLAYED = ("joint_states", "cylinder_pressures")


def generate_launch_description() -> LaunchDescription:
    """The node configures and activates itself; the player waits until it listens."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            node(
                package="crane_identification",
                executable="identification",
                parameters={
                    "machine": ("machine", str),
                    "model": ("model", str),
                    "model_output": ("model_output", str),
                    "forgetting": ("forgetting", float),
                    "use_sim_time": ("use_sim_time", bool),
                },
            ),
            node(
                package="crane_nodes",
                executable="player",
                arguments=(
                    *(LaunchConfiguration("play"), "--topics", *PLAYED, "--wait-for", *PLAYED),
                ),
                only_with="play",
            ),
        ]
    )
