"""The time of a node: simulated where it is told so, and never standing still for ever."""

from collections.abc import Callable, Iterator

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from crane_bags.clocks import TimeBack
from crane_nodes import node_time
from crane_nodes.executor import Polled
from crane_nodes.node_time import (
    TAKEN_PROFILE,
    TAKEN_TOPIC,
    NodeTime,
    Pacing,
    nanoseconds,
    stamp_of,
    tell_back,
)

SECOND = 10**9


def test_time_that_went_back_is_a_warning_while_it_is_news() -> None:
    back, status = TimeBack(), DiagnosticStatus(level=DiagnosticStatus.OK, message="good")
    back.comes("joint_states", 20 * SECOND)
    back.comes("joint_states", 8 * SECOND)
    tell_back(back, status)
    assert status.level == DiagnosticStatus.WARN
    assert status.message == "time went back by 12.0 s: started again; good"
    assert [one.value for one in status.values] == ["1", "12.000"]


class Real:
    """The steady clock, set by hand."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def real(monkeypatch: pytest.MonkeyPatch) -> Real:
    one = Real()
    monkeypatch.setattr(node_time, "time", one)
    return one


@pytest.fixture
def make(ros_domain: int) -> Iterator[Callable[[bool], Node]]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    made: list[Node] = []

    def node(simulated: bool) -> Node:
        given = [Parameter("use_sim_time", value=simulated)]
        made.append(Node("alone", context=context, parameter_overrides=given))
        return made[-1]

    yield node
    for one in made:
        one.destroy_node()
    rclpy.shutdown(context=context)


def tick(seconds: float) -> Clock:
    return Clock(clock=stamp_of(round(seconds * SECOND)))


def test_real_time_is_the_steady_clock(make: Callable[[bool], Node], real: Real) -> None:
    clock = NodeTime(make(False))
    assert not clock.simulated
    assert clock.now() == 100.0
    assert clock.of(stamp_of(5 * SECOND)) == 100.0
    real.now = 101.0
    assert clock.now() == 101.0


def test_simulated_time_is_that_of_the_newest_tick(
    make: Callable[[bool], Node], real: Real
) -> None:
    node = make(True)
    clock = NodeTime(node)
    assert not clock.known
    clock.tell(tick(7.0))
    assert clock.known
    real.now += 50.0  # less than PATIENCE_S: whoever ticks may be slow
    assert clock.now() == 7.0
    assert clock.stamp() == stamp_of(7 * SECOND)
    assert node.get_clock().now().nanoseconds == 7 * SECOND, "that of rclpy is the same"


def test_a_message_brings_its_time_before_its_tick_comes(
    make: Callable[[bool], Node], real: Real
) -> None:
    clock = NodeTime(make(True))
    clock.tell(tick(7.0))
    assert clock.of(stamp_of(8 * SECOND)) == 8.0
    assert clock.now() == 8.0
    assert clock.of(stamp_of(6 * SECOND)) == 6.0
    assert clock.now() == 8.0, "an old message does not turn it back"


def test_messages_show_that_time_goes_on_while_its_ticks_are_not_taken(
    make: Callable[[bool], Node], real: Real
) -> None:
    clock = NodeTime(make(True))
    clock.tell(tick(7.0))
    for seconds in (8, 9, 10):
        real.now += 0.5 * node_time.PATIENCE_S
        clock.of(stamp_of(seconds * SECOND))
    assert clock.now() == 10.0


def test_time_goes_on_when_nobody_ticks_any_more(make: Callable[[bool], Node], real: Real) -> None:
    clock = NodeTime(make(True))
    clock.tell(tick(7.0))
    real.now += node_time.PATIENCE_S + 0.5
    assert clock.now() == 7.5
    clock.tell(tick(7.0))  # it was only slow
    assert clock.now() == 7.0


def test_a_node_says_how_far_the_crane_may_go(make: Callable[[bool], Node], real: Real) -> None:
    node = make(True)
    listener = make(False)
    heard = Polled(listener, Header, TAKEN_TOPIC, TAKEN_PROFILE)
    clock = NodeTime(node)
    clock.tell(tick(7.0))
    pacing = Pacing(node, clock, ahead=1.0)
    for seconds in (7.1, 7.2, 7.5):  # not at each of them: a quarter of what it leaves is enough
        clock.tell(tick(seconds))
        pacing.taken()
    found: list[Header] = []
    while len(found) < 2:
        found += [message for message, _ in heard.take()]
    assert [nanoseconds(one.stamp) for one in found] == [8 * SECOND, round(8.5 * SECOND)]
    assert {one.frame_id for one in found} == {"/alone"}


def test_in_real_time_a_node_says_nothing(make: Callable[[bool], Node]) -> None:
    node = make(False)
    Pacing(node, NodeTime(node), ahead=1.0).taken()
    assert node.count_publishers(TAKEN_TOPIC) == 0
