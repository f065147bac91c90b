"""What clients of a driver know of it, and how they find it; drivers here are played."""

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from crane_bags.types import DRIVER_STATE
from crane_interfaces.msg import DriverState
from crane_nodes import DriverClient, NoDriverError, driver_client
from crane_nodes.driver_client import LATCHED, SERVICES, STATE_TOPIC

PATIENCE = 120.0  # s, bounds a failing test, be it in the idle class of the scheduler


class Played:
    """A driver by any name that says what it is told to, and counts what it is asked."""

    def __init__(self, graph: "Graph", name: str):
        self.node = graph.node(name)
        self.asked: list[str] = []
        self._publisher = self.node.create_publisher(DriverState, STATE_TOPIC, LATCHED)
        for service in SERVICES:
            self.node.create_service(Trigger, f"~/{service}", self._answer(service))

    def tells(self, state: int, cause: str = "", remedy: str = "") -> None:
        name = self.node.get_fully_qualified_name()
        self._publisher.publish(DriverState(node=name, state=state, cause=cause, remedy=remedy))

    def _answer(self, service: str) -> Callable[..., Trigger.Response]:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.asked.append(service)
            response.success = True
            return response

        return answer


class Graph:
    """Nodes of one namespace, and one thread for them."""

    def __init__(self, domain: int):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._nodes: list[Node] = []

    def node(self, name: str, namespace: str = "/left") -> Node:
        made = Node(name, context=self._context, namespace=namespace)
        self._nodes.append(made)
        self._executor.add_node(made)
        return made

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def graph(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """Where drivers that tell their state once, as those here do, are heard all the time."""
    monkeypatch.setattr(driver_client, "DRIVER_SILENCE_S", PATIENCE)
    one = Graph(ros_domain)
    yield one
    one.close()


def test_without_a_driver_it_says_so_and_asks_nobody(graph: Graph) -> None:
    client = DriverClient(graph.node("client"))
    assert client.state.state == DriverState.STATE_UNKNOWN
    assert client.state.text == "no driver"
    assert client.problem.startswith(
        "no driver publishes its state on /left/driver/state; start it"
    )
    assert not client.ready
    for request in (client.enable, client.disable, client.reset_fault, client.stop):
        with pytest.raises(
            NoDriverError, match="no driver publishes its state on /left/driver/state"
        ):
            request()


def test_a_driver_is_found_by_whatever_name_and_asked_at_its_services(graph: Graph) -> None:
    driver = Played(graph, "anton")
    driver.tells(DriverState.STATE_DISABLED, "the driver is disabled", "call enable")
    told: list[int] = []
    client = DriverClient(graph.node("client"), lambda state: told.append(state.state))
    graph.until(lambda: client.ready)  # it joined after the state was told
    assert client.problem == "/left/anton: the driver is disabled; call enable"
    futures = [client.enable(), client.disable(), client.reset_fault(), *client.stop()]
    graph.until(lambda: all(future.done() for future in futures))
    assert driver.asked == list(SERVICES)
    driver.tells(DriverState.STATE_ENABLED)
    graph.until(lambda: not client.problem)
    assert told == [DriverState.STATE_DISABLED, DriverState.STATE_ENABLED]


def test_a_driver_of_another_namespace_is_another_cranes(graph: Graph) -> None:
    right = DriverClient(graph.node("client", "/right"))
    left = DriverClient(graph.node("client"))
    Played(graph, "driver").tells(DriverState.STATE_ENABLED)
    graph.until(lambda: not left.problem)
    assert right.state.text == "no driver"


def test_of_two_drivers_none_is_asked_but_both_are_stopped(graph: Graph) -> None:
    drivers = [Played(graph, "anton"), Played(graph, "berta")]
    client = DriverClient(graph.node("client"))
    for one in drivers:
        one.tells(DriverState.STATE_ENABLED)
    graph.until(lambda: client.state.text == "several drivers")
    assert client.problem.startswith("/left/anton, /left/berta are drivers in one namespace; stop")
    assert not client.ready
    with pytest.raises(NoDriverError, match="/left/anton, /left/berta are drivers in one names"):
        client.enable()
    drivers[0].tells(DriverState.STATE_FINALIZED)
    graph.until(lambda: client.state.node == "/left/berta")
    graph.until(lambda: client.ready)
    drivers[0].tells(DriverState.STATE_ENABLED)
    graph.until(lambda: client.state.text == "several drivers")
    client.stop()
    graph.until(lambda: all(one.asked == ["emergency_stop"] for one in drivers))


def test_a_silent_driver_is_gone_but_may_still_be_stopped(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = Played(graph, "driver")
    driver.tells(DriverState.STATE_ENABLED)
    client = DriverClient(graph.node("client"))
    graph.until(lambda: client.ready)
    monkeypatch.setattr(driver_client, "DRIVER_SILENCE_S", 0.0)
    assert client.state.text == "no driver"
    assert "no driver publishes its state" in client.problem
    assert client.newest.state == DriverState.STATE_ENABLED
    futures = [client.disable(), *client.stop()]
    graph.until(lambda: all(future.done() for future in futures))
    assert driver.asked == ["disable", "emergency_stop"]


def test_the_state_is_recorded_under_the_name_that_the_driver_gives_it() -> None:
    assert DRIVER_STATE.relative == STATE_TOPIC
