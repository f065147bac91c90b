"""The life of a managed node as a process: started by itself or by others, shut down in order."""

import gc
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from crane_model.cli import run
from crane_model.errors import ConfigurationError
from crane_nodes.command_line import check_arguments
from crane_nodes.context import ros
from crane_nodes.executor import KeptExecutor
from crane_nodes.parameters import NodeParameter, Switch

AUTOSTART = Switch("autostart", True, "Configure and activate the node when it starts")
"""To be declared by every managed node."""

WAKE_PERIOD_S = 0.1  # a signal is seen after at most this
ANSWER_TIME_S = 0.2  # after the shutdown, in which those who wait for its end are answered


def run_managed(
    name: str,
    make: Callable[[], LifecycleNode],
    about: str,
    parameters: Sequence[NodeParameter],
    argv: Sequence[str] | None,
) -> int:
    """Run the node that `make` makes until a signal asks it to stop; the exit status.

    Whatever ends it, its shutdown transition runs while ROS is still there, so that the node can
    bring to an end what it has begun. Status 1 where it does not start. `--help` tells what it is
    `about` and its `parameters`; other arguments than those of ROS are refused with status 2.
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
            # What is there to stay need not be looked through for garbage: 60 ms each time.
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
