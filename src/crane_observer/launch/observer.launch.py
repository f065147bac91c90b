"""The nodes that watch: positions without encoders, faulty sensors, the load at the tip."""

from launch import LaunchDescription

from crane_nodes.launching import COMMON, declared, node

ARGUMENTS = COMMON | {
    "machine": "Machine: name, folder or machine file",
    "model": "Identified model file with hydraulics",
    "without": "Joints whose encoders are not to be used, separated by blanks",
    "tolerance": "File that check_sensors --learn wrote",
}


def generate_launch_description() -> LaunchDescription:
    """The nodes configure and activate themselves; none of them commands anything."""
    return LaunchDescription(
        [
            *declared(ARGUMENTS),
            node(
                package="crane_observer",
                executable="position_estimator",
                parameters={
                    "machine": ("machine", str),
                    "model": ("model", str),
                    "without": ("without", str),
                },
            ),
            node(
                package="crane_observer",
                executable="sensor_monitor",
                parameters={
                    "machine": ("machine", str),
                    "model": ("model", str),
                    "tolerance": ("tolerance", str),
                },
            ),
            node(
                package="crane_observer",
                executable="payload_estimator",
                parameters={"machine": ("machine", str), "model": ("model", str)},
            ),
        ]
    )
