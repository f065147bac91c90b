"""Simulated time on the bus: the simulated crane and its driver advance in lock-step.

After the readings of each cycle the crane sends the time at which it took them. It goes on only
when the driver has sent that time back, behind the valve frames that answer the readings. So the
load of the computer changes how long a cycle takes, and nothing else. Both frames have identifiers
of their own. Real valves do not wait: a bus that can leave this computer is refused.
"""

from crane_driver.can.bus import BusSettings
from crane_driver.can.frame import Frame
from crane_model.errors import ConfigurationError

TIME, STEP = 0x1FC0DE01, 0x1FC0DE02  # extended identifiers: of the crane, of the driver
START_NS = 1_000_000_000  # of the first cycle; a ROS time of 0 stands for an unknown one
LENGTH = 8  # bytes


def time_frame(time: int) -> Frame:
    """Frame by which the crane says that the readings of `time` [ns] have been sent."""
    return Frame(TIME, time.to_bytes(LENGTH, "little"), extended=True)


def step_frame(time: int) -> Frame:
    """Frame by which the driver says that the valve frames for `time` [ns] have been sent."""
    return Frame(STEP, time.to_bytes(LENGTH, "little"), extended=True)


def told_time(frame: Frame, identifier: int) -> int | None:
    """Time [ns] that a frame with the identifier tells; None for any other frame."""
    if frame.id != identifier or not frame.extended or len(frame.data) != LENGTH:
        return None
    return int.from_bytes(frame.data, "little")


def check_private(settings: BusSettings) -> None:
    """Check that frames cannot leave this computer.

    Raises
    ------
    ConfigurationError
        If the bus is not a virtual one, nor udp_multicast with a hop limit of 0.
    """
    hops = settings.extra.get("hop_limit", 0)
    if settings.interface == "virtual" or (settings.interface == "udp_multicast" and hops == 0):
        return
    limit = f" with hop_limit {hops}" if settings.interface == "udp_multicast" else ""
    raise ConfigurationError(
        f"simulated time: CAN bus {settings}{limit} can leave this computer, and real valves do "
        "not wait; use udp_multicast with hop_limit 0, or run without simulated time"
    )
