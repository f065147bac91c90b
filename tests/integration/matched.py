"""When a node under test has found who listens to it, so that its first message is not lost."""

import time
from collections.abc import Callable

from lifecycle_msgs.srv import GetState
from rclpy.node import Node

AGAIN = 2.0  # s: an answer is lost where ROS has not found who asked


def wait_until_heard(node: Node, name: str, wait: Callable[[Callable[[], object]], None]) -> None:
    """Until the managed node `name` has found the subscriptions that `node` has made so far.

    The graph tells only what `node` has found. ROS tells others of subscriptions in their order,
    and an answer comes by one that is made here, after them. `wait` lets `node` work until a
    condition holds.
    """
    client = node.create_client(GetState, f"{name}/get_state")
    wait(client.service_is_ready)
    answered = False
    while not answered:
        asked, until = client.call_async(GetState.Request()), time.monotonic() + AGAIN
        wait(lambda: asked.done() or time.monotonic() > until)  # noqa: B023
        answered = asked.done()
    node.destroy_client(client)
