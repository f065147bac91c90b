"""What makes nodes talk through this computer's loopback alone, without the stall of a newcomer."""

from collections.abc import Mapping

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "RMW_IMPLEMENTATION"


def variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment variables for processes that begin in `environment`.

    LOCALHOST would do, but with Fast DDS it shares memory, and a node that joins then holds up all
    that publish (config/this_computer.xml). `scripts/env.sh` sets the same.
    """
    from ament_index_python.packages import get_package_share_path  # absent without ROS

    if not environment.get(MIDDLEWARE, "rmw_fastrtps_cpp").startswith("rmw_fastrtps"):
        return {RANGE: "LOCALHOST"}
    profiles = get_package_share_path("crane_nodes") / "config" / "this_computer.xml"
    return {RANGE: "SYSTEM_DEFAULT", PROFILES: str(profiles)}
