"""What makes nodes talk through this computer's loopback alone, where no newcomer stalls them."""

from collections.abc import Mapping

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "RMW_IMPLEMENTATION"
FAST_DDS = "rmw_fastrtps"


def variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment variables for processes that begin in `environment`, whatever it says of RANGE.

    LOCALHOST would do, but with Fast DDS it shares memory, and a node that joins then holds up
    every publisher (config/this_computer.xml). `scripts/env.sh` sets the same. `FileNotFoundError`
    if the profile is not installed: without it Fast DDS would use all networks.
    """
    from ament_index_python.packages import get_package_share_path  # absent without ROS

    middleware = environment.get(MIDDLEWARE) or f"{FAST_DDS}_cpp"
    own = get_package_share_path("crane_nodes") / "config" / "this_computer.xml"
    profiles = environment.get(PROFILES) or str(own)
    if not middleware.startswith(FAST_DDS) or not profiles.endswith(f"/config/{own.name}"):
        return {MIDDLEWARE: middleware, RANGE: "LOCALHOST"}
    own.resolve(strict=True)
    return {MIDDLEWARE: middleware, RANGE: "SYSTEM_DEFAULT", PROFILES: str(own)}
