"""One conformance suite for the executor of the suite and for rclpy's own."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from crane_interfaces.action import RunExcitation
from crane_nodes.executor import KeptExecutor, Polled

PATIENCE = 120.0  # s, bounds a failing test
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class Graph:
    """A node that talks to itself, and who serves it."""

    def __init__(self, kind: type[Executor], domain: int):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("alone", context=self.context)
        self.executor = kind(context=self.context)
        self.executor.add_node(self.node)

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            self.executor.spin_once(timeout_sec=0.05)

    def heard(self, topic: str) -> list[str]:
        """What comes on a topic that has its publisher already."""
        found: list[str] = []
        self.node.create_subscription(
            String, topic, lambda message: found.append(message.data), QoSProfile(depth=10)
        )
        return found


@pytest.fixture(params=[KeptExecutor, SingleThreadedExecutor])
def graph(request: pytest.FixtureRequest, ros_domain: int) -> Iterator[Graph]:
    one = Graph(request.param, ros_domain)
    yield one
    one.executor.shutdown()
    one.node.destroy_node()
    rclpy.shutdown(context=one.context)


def test_messages_come_in_order_and_each_once(graph: Graph) -> None:
    publisher = graph.node.create_publisher(String, "said", 10)
    found = graph.heard("said")
    graph.until(publisher.get_subscription_count)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    graph.until(lambda: len(found) >= 5)
    graph.executor.spin_once(timeout_sec=0.05)
    assert found == list("01234")


def test_what_is_created_in_a_callback_is_served(graph: Graph) -> None:
    publisher = graph.node.create_publisher(String, "later", 10)
    found: list[list[str]] = []

    def create() -> None:
        graph.node.destroy_timer(timer)  # itself, while it is served
        found.append(graph.heard("later"))

    timer = graph.node.create_timer(0.01, create, clock=STEADY)
    graph.until(lambda: found and publisher.get_subscription_count())
    publisher.publish(String(data="heard"))
    graph.until(lambda: found[0] == ["heard"])
    assert len(found) == 1


def test_what_a_callback_destroys_is_served_no_more(graph: Graph) -> None:
    publisher = graph.node.create_publisher(String, "said", 10)
    found: list[str] = []

    def take(message: String) -> None:
        found.append(message.data)
        while entities:
            destroy, entity = entities.pop()
            destroy(entity)

    node, trigger = graph.node, graph.node.create_guard_condition(lambda: found.append("guard"))
    service = node.create_service(Trigger, "gone", lambda _, answer: answer)
    client = node.create_client(Trigger, "gone")
    graph.until(client.service_is_ready)
    node.create_subscription(String, "said", take, 10)
    other = node.create_subscription(String, "said", take, 10)
    entities = [
        (node.destroy_subscription, other),
        (node.destroy_service, service),
        (node.destroy_client, client),
    ]
    graph.until(lambda: publisher.get_subscription_count() == 2)
    client.call_async(Trigger.Request())
    publisher.publish(String(data="first"))
    time.sleep(0.05)  # all are ready in one turn, if this is long enough
    graph.until(lambda: "first" in found)
    publisher.publish(String(data="last"))
    graph.until(lambda: "last" in found)
    assert "guard" not in found
    trigger.trigger()
    graph.until(lambda: "guard" in found)


def test_a_polled_topic_is_left_to_who_polls_it(graph: Graph) -> None:
    publisher = graph.node.create_publisher(String, "polled", 10)
    topic = Polled(graph.node, String, "polled", QoSProfile(depth=10))
    graph.until(publisher.get_subscription_count)
    publisher.publish(String(data="kept"))
    taken: list[str] = []

    def polled() -> bool:
        taken.extend(message.data for message, _ in topic.take())
        return bool(taken)

    graph.until(polled)
    assert taken == ["kept"]


def test_services_and_their_clients(graph: Graph) -> None:
    async def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, "asked"
        return response

    graph.node.create_service(Trigger, "ask", answer)
    client = graph.node.create_client(Trigger, "ask")
    graph.until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    graph.executor.spin_until_future_complete(future, timeout_sec=PATIENCE)
    assert future.result() == Trigger.Response(success=True, message="asked")


def test_an_action_whose_goal_awaits_a_timer(graph: Graph) -> None:
    ticked = Future()

    async def execute(goal: Any) -> RunExcitation.Result:
        await ticked
        goal.succeed()
        return RunExcitation.Result(message="done")

    server = ActionServer(graph.node, RunExcitation, "act", execute)
    client = ActionClient(graph.node, RunExcitation, "act")
    graph.until(client.server_is_ready)
    sent = client.send_goal_async(RunExcitation.Goal())
    graph.until(sent.done)
    ending = sent.result().get_result_async()
    assert not ending.done()
    graph.node.create_timer(
        0.01, lambda: None if ticked.done() else ticked.set_result(None), clock=STEADY
    )
    graph.until(ending.done)
    assert ending.result().result.message == "done"
    server.destroy()
    client.destroy()


def test_a_guard_triggered_by_another_thread_wakes(graph: Graph) -> None:
    woken: list[int] = []
    guard = graph.node.create_guard_condition(lambda: woken.append(1))
    thread = threading.Timer(0.05, guard.trigger)
    thread.start()
    while not woken:
        graph.executor.spin_once(timeout_sec=PATIENCE)
    thread.join()
    assert woken == [1]


def test_the_error_of_a_callback_reaches_who_spins(graph: Graph) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    graph.node.create_timer(0.01, fail, clock=STEADY)
    with pytest.raises(ZeroDivisionError):
        graph.until(lambda: False)


def test_the_error_of_a_coroutine_reaches_who_spins(graph: Graph) -> None:
    async def fail() -> None:
        raise ZeroDivisionError

    graph.node.create_timer(0.01, fail, clock=STEADY)
    with pytest.raises(ZeroDivisionError):
        graph.until(lambda: False)


def test_a_wait_ends_with_its_time(graph: Graph) -> None:
    for _ in range(5):  # rid of what the creation of the node left to be done
        graph.executor.spin_once(timeout_sec=0.0)
    begun = time.monotonic()
    graph.executor.spin_once(timeout_sec=0.2)
    assert time.monotonic() - begun >= 0.15
