"""The trajectory node, which waits for goals of the action RunExcitation."""

from launch import LaunchDescription

from crane_nodes.launching import COMMON, declared, node

ARGUMENTS = COMMON | {
    "machine": "Machine: name, folder or machine file",
    "clearance": "File of the clearance of the boom tip",
    "controller": "File of the gains, as bring-up writes it",
    "law": "Control law, for example flow_and_pressures",
    "law_model": "Model file with hydraulics for that law",
}


def generate_launch_description() -> LaunchDescription:
    """The node configures and activates itself; nothing moves before a goal is sent."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            node(
                package="crane_trajectory",
                executable="trajectory",
                parameters={
                    "machine": ("machine", str),
                    "clearance": ("clearance", str),
                    "controller": ("controller", str),
                    "law": ("law", str),
                    "model": ("law_model", str),
                },
            ),
        ]
    )
