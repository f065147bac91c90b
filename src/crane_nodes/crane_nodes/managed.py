"""Names and life of a node as a process: its command line, its context, its end."""

import argparse
import gc
import signal
import sys
import textwrap
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import remove_ros_args

from crane_model.cli import command_line, run
from crane_model.errors import ConfigurationError
from crane_nodes.executor import KeptExecutor
from crane_nodes.parameters import NodeParameter, Switch

NAME_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # ROS may find a publisher before the name of its node
UNNAMED = "a node not known by name yet"
NAME_LOOKS = 5  # after which a publisher is pointed out without a name

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

PACKAGES_OF_EVERY_NODE = ("lifecycle_msgs", "rcl_interfaces", "type_description_interfaces")

HELP_WIDTH = 98
SIMULATED = "  use_sim_time (default: false)\n      Run on simulated time from /clock"

AUTOSTART = Switch("autostart", True, "Configure and activate the node when it starts")
"""To be declared by every managed node."""
WAKE_PERIOD_S = 0.1  # a signal is seen after at most this
ANSWER_TIME_S = 0.2  # after the shutdown, in which those who wait for its end are answered


def full_name(node: Node) -> str:
    """Namespace and name, without the leading slash: `left/driver`, or `driver` in the root.

    So begin the names of statuses on /diagnostics, a topic that all nodes of a domain share.
    """
    return node.get_fully_qualified_name().lstrip("/")


class NameLooks:
    """Looks at publishers that are pointed out once: their names follow, as a rule."""

    def __init__(self) -> None:
        self._unnamed: Counter[str] = Counter()  # looks, by topic

    def suffice(self, topic: str, names: Collection[str]) -> bool:
        """Return whether to point out `names` at this look: they are known, or for long not."""
        if UNNAMED not in names or self._unnamed[topic] >= NAME_LOOKS:
            return True
        self._unnamed[topic] += 1
        return False


def publishers(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, each once, in order."""
    return node_names(node.get_publishers_info_by_topic(topic))


def node_names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Full names of the nodes of publishers, each once, in order; `UNNAMED` last."""
    found = {(endpoint.node_namespace, endpoint.node_name) for endpoint in endpoints}
    known = sorted(f"{space}/{name}".lstrip("/") for space, name in found if name != NAME_UNKNOWN)
    unnamed = any(name == NAME_UNKNOWN for _, name in found)
    return [*known, UNNAMED] if unnamed else known


class Stop:
    """A signal's request to stop the process."""

    requested = False

    def request(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[Stop]:
    """Start ROS for a `with` block, in which SIGINT, SIGTERM and SIGHUP only request a stop.

    So whatever is being closed is closed to its end, however often Ctrl-C is pressed.

    Parameters
    ----------
    argv
        Arguments of the command line, for example `--ros-args -r __ns:=/left`.

    Yields
    ------
    Stop
        Tells by `requested` whether a signal came.
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


def say_ready(node: Node, *actions: str) -> None:
    """Log `ready: listens to ...; publishes ...; serves ...`, with full names.

    Whoever waits for a node, or reads its log, needs to know this line alone. `actions` are served
    beside the services of the node; what every node has is left out.
    """
    listened = [
        (subscription.msg_type, subscription.topic_name) for subscription in node.subscriptions
    ]
    published = [(publisher.msg_type, publisher.topic_name) for publisher in node.publishers]
    served = [(service.srv_type, service.service_name) for service in node.services]
    parts = {
        "listens to": _own(listened),
        "publishes": _own(published),
        "serves": [*_own(served), *map(node.resolve_service_name, actions)],
    }
    text = "; ".join(f"{verb} {', '.join(names)}" for verb, names in parts.items() if names)
    node.get_logger().info(f"ready: {text}")


def _own(entities: Iterable[tuple[Any, str]]) -> list[str]:
    """Names of those whose type is none that every node has, each once."""
    return list(dict.fromkeys(name for kind, name in entities if not _of_every_node(kind)))


def _of_every_node(kind: type[Any]) -> bool:
    return kind.__module__.partition(".")[0] in PACKAGES_OF_EVERY_NODE


def check_arguments(
    name: str, about: str, parameters: Sequence[NodeParameter], argv: Sequence[str]
) -> None:
    """Explain the node and end if `argv` asks for it, or holds what is no argument of ROS."""
    parser = command_line(
        prog=name,
        usage=f"{name} [-h] [--ros-args [-p PARAMETER:=VALUE] [--params-file FILE] ...]",
        description=about,
        epilog="\n".join(["parameters:", *map(_entry, parameters), SIMULATED]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.parse_args(own_arguments(argv))


def own_arguments(argv: Sequence[str]) -> list[str]:
    """Those that are not for ROS; ends the process where ROS cannot read its own."""
    try:
        return remove_ros_args(["", *argv])[1:]
    except RuntimeError as error:
        reason = str(error).partition(", at ")[0]  # what follows names lines of rcl's sources
        sys.exit(f"error: {reason}")


def ros_arguments(argv: Sequence[str]) -> list[str]:
    """Those that are for ROS: from each --ros-args to the next --, or to the end."""
    found: list[str] = []
    inside = False
    for word in argv:
        inside = inside or word == "--ros-args"
        if inside:
            found.append(word)
        inside = inside and word != "--"
    return found


def _entry(parameter: NodeParameter) -> str:
    text = textwrap.fill(
        parameter.description, HELP_WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6
    )
    return f"  {parameter.name} (default: {_shown(parameter.default)})\n{text}"


def _shown(default: str | bool | float | tuple[float, ...]) -> str:
    """As it is written after `:=`."""
    if isinstance(default, bool):
        return str(default).lower()
    return str(list(default)) if isinstance(default, tuple) else str(default) or "empty"


def run_managed(
    name: str,
    make: Callable[[], LifecycleNode],
    about: str,
    parameters: Sequence[NodeParameter],
    argv: Sequence[str] | None,
) -> int:
    """Run a managed node until a signal asks it to stop.

    Whatever ends it, its shutdown transition runs while ROS is still there, so that the node can
    bring to an end what it has begun.

    Parameters
    ----------
    name
        Name of the command.
    make
        Makes the node.
    about, parameters
        Text and parameters that `--help` shows.
    argv
        Arguments of the command line; None: those of the process. Others than those of ROS are
        refused with status 2.

    Returns
    -------
    int
        Exit status: 0, or 1 if the node does not start.
    """
    given = sys.argv[1:] if argv is None else argv
    check_arguments(name, about, parameters, given)
    return run(lambda: _live(make, given))


def _live(make: Callable[[], LifecycleNode], argv: Sequence[str]) -> None:
    with ros(argv) as stop:
        node = make()
        executor = KeptExecutor()
        try:
            if AUTOSTART.read(node):
                _start(node)
            executor.add_node(node)
            # Permanent objects need not be looked through for garbage: 60 ms each time.
            gc.collect()
            gc.freeze()
            while not stop.requested:
                executor.spin_once(timeout_sec=WAKE_PERIOD_S)
        finally:
            with suppress(RuntimeError):  # of rclpy: `ros2 lifecycle set` has shut it down before
                node.trigger_shutdown()
            until = time.monotonic() + ANSWER_TIME_S
            while (left := until - time.monotonic()) > 0.0:
                with suppress(Exception):  # a defect that has ended the node may come again
                    executor.spin_once(timeout_sec=left)


def _start(node: LifecycleNode) -> None:
    for transition in (node.trigger_configure, node.trigger_activate):
        if transition() is not TransitionCallbackReturn.SUCCESS:
            raise ConfigurationError(f"{node.get_name()} does not start; the lines above say why")
