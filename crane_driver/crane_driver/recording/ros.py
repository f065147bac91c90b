"""Between rclpy and the parts of the recorder and the player that know nothing of it."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from crane_driver.recording.qos import Service

NANOSECONDS = 1_000_000_000
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def profile(service: Service) -> QoSProfile:
    """The profile of a publisher or a subscription."""
    return QoSProfile(
        depth=service.depth,
        reliability=(
            ReliabilityPolicy.RELIABLE if service.reliable else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if service.latched else DurabilityPolicy.VOLATILE
        ),
    )


def offered(found: QoSProfile) -> Qos:
    """The profile of a publisher as bags state it; both number the policies as rmw does."""
    return Qos(
        history=QosHistory(found.history.value),
        depth=found.depth,
        reliability=QosReliability(found.reliability.value),
        durability=QosDurability(found.durability.value),
        deadline=QosTime(*divmod(found.deadline.nanoseconds, NANOSECONDS)),
        lifespan=QosTime(*divmod(found.lifespan.nanoseconds, NANOSECONDS)),
        liveliness=QosLiveliness(found.liveliness.value),
        liveliness_lease_duration=QosTime(
            *divmod(found.liveliness_lease_duration.nanoseconds, NANOSECONDS)
        ),
        avoid_ros_namespace_conventions=found.avoid_ros_namespace_conventions,
    )


class Stop:
    """Whether a signal has asked the process to stop."""

    requested = False

    def request(self, _number: int, _frame: FrameType | None) -> None:
        """The handler of the signals."""
        self.requested = True


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[Stop]:
    """ROS within the `with` block, where SIGINT, SIGTERM and SIGHUP only set what it gives.

    So whatever is being closed is closed to its end, however often Ctrl-C is pressed.
    """
    stop = Stop()
    previous = {number: signal.signal(number, stop.request) for number in SIGNALS}
    rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield stop
    finally:
        rclpy.try_shutdown()
        for number, handler in previous.items():
            signal.signal(number, handler)
