"""What makes nodes talk through this computer's loopback alone, where no newcomer stalls them."""

from collections.abc import Mapping
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "RMW_IMPLEMENTATION"
FAST_DDS = "rmw_fastrtps"
LEASE = "<discovery_config><leaseDuration><sec>120</sec></leaseDuration></discovery_config>"
"""Time for which a process that does not run stays known; the default of Fast DDS is 20 s."""


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


def patient_variables(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Environment variables for processes on simulated time, which wait for one another.

    A process that is stopped for half a minute must not lose its connections meanwhile. The profile
    with a longer lease is written to `folder`. The other variables are those of `variables`.
    """
    found = variables(environment)
    if PROFILES in found:
        profile = Path(found[PROFILES]).read_text(encoding="utf-8")
        path = folder.absolute() / "simulated_time.xml"
        path.write_text(profile.replace("<builtin>", f"<builtin>{LEASE}"), encoding="utf-8")
        found[PROFILES] = str(path)
    return found
