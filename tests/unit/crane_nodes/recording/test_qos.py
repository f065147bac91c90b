"""What is asked of publishers and offered in their place, against the rules of DDS."""

import itertools

from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)

from crane_nodes.recording.ros import WAITING_MESSAGES, offer, offered, profile, request

PROFILES = [
    QoSProfile(depth=depth, reliability=reliability, durability=durability)
    for depth in (1, 7)
    for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
    for durability in (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
]
GROUPS = [group for size in (1, 2, 3) for group in itertools.combinations(PROFILES, size)]


def compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """As rmw judges it; it warns of policies that are left to the middleware."""
    return qos_check_compatible(publisher, subscription)[0] != QoSCompatibility.ERROR


def test_request_hears_every_publisher_and_asks_for_the_most() -> None:
    for group in GROUPS:
        asked = profile(request([offered(one) for one in group]))
        assert all(compatible(one, asked) for one in group)
        all_reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in group)
        all_latched = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in group)
        assert (asked.reliability == ReliabilityPolicy.RELIABLE) == all_reliable
        assert (asked.durability == DurabilityPolicy.TRANSIENT_LOCAL) == all_latched


def test_who_is_heard() -> None:
    for asked, other in itertools.product(PROFILES, PROFILES):
        service = request([offered(asked)])
        assert service.hears(offered(other)) == compatible(other, profile(service))


def test_offer_is_heard_by_all_who_heard_one_of_the_publishers() -> None:
    for group, subscription in itertools.product(GROUPS, PROFILES):
        if any(compatible(one, subscription) for one in group):
            assert compatible(profile(offer([offered(one) for one in group])), subscription)


def test_latched_topic_keeps_what_its_publishers_kept() -> None:
    latched = [one for one in PROFILES if one.durability == DurabilityPolicy.TRANSIENT_LOCAL]
    assert offer([offered(one) for one in latched]).depth == 1 + 1 + 7 + 7


def test_depth_is_not_discovered() -> None:
    """Recordings state a depth of 0: each publisher of a latched topic then kept one."""
    unknown = [offered(PROFILES[1])._replace(depth=0)] * 3
    assert offer(unknown).depth == 3
    assert offer([offered(PROFILES[0])]).depth == WAITING_MESSAGES
    assert offer([]).depth == WAITING_MESSAGES
