"""Between rclpy and the parts of the recorder and the player that know nothing of it."""

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
from crane_nodes.recording.qos import Service


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
