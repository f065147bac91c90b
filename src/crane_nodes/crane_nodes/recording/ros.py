"""Between rclpy and the recorder and player: messages and quality of service."""

from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from crane_bags.clocks import NANOSECONDS

WAITING_MESSAGES = 1000  # messages that may wait: 5 s at 200 Hz


@dataclass(frozen=True)
class Service:
    """The policies that decide who hears whom, and how many messages are kept."""

    reliable: bool
    latched: bool  # transient local
    depth: int

    def __str__(self) -> str:
        words = ["reliable" if self.reliable else "best effort", *["latched"] * self.latched]
        return ", ".join(words)

    def hears(self, offered: Qos) -> bool:
        """Return whether a subscription that asks for this receives from such a publisher."""
        reliable = offered.reliability != QosReliability.BEST_EFFORT
        return (reliable or not self.reliable) and (_latched(offered) or not self.latched)


def request(offered: Sequence[Qos]) -> Service:
    """The most that every one of the publishers fulfils, as `ros2 bag record` asks for it."""
    return Service(
        reliable=all(profile.reliability != QosReliability.BEST_EFFORT for profile in offered),
        latched=all(_latched(profile) for profile in offered),
        depth=WAITING_MESSAGES,
    )


def offer(recorded: Sequence[Qos]) -> Service:
    """Quality of service of one publisher that replaces the recorded ones: to all who heard those.

    A latched topic keeps as many messages as its publishers kept together; discovery does not show
    the depth of a history (it is 0 in recordings), then one each.
    """
    latched = [max(profile.depth, 1) for profile in recorded if _latched(profile)]
    return Service(reliable=True, latched=bool(latched), depth=sum(latched) or WAITING_MESSAGES)


def _latched(offered: Qos) -> bool:
    return offered.durability == QosDurability.TRANSIENT_LOCAL


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
