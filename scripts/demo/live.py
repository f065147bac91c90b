"""The live half of the demo: the suite as processes around the stand-in machine, on a CAN bus."""

import os
import re
import socket
import subprocess
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Self

import rclpy
from laws import EXCITATION, VALIDATION, Law
from processes import DemoError, Processes
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from crane_bags.types import JOINT_STATES
from crane_interfaces.msg import DriverState
from crane_nodes.driver_client import DriverClient
from crane_nodes.executor import KeptExecutor

DOMAINS = 101  # ROS_DOMAIN_ID 1 to this can be used on every Linux
FIT_PERIODS, VALIDATION_PERIODS, FOLLOW_PERIODS = 3, 2, 1
# Of SCHED_FIFO, as docs/how_to/real_time.md has them, for a browser that draws on the same cores;
# the driver asks for 50.
MACHINE_PRIORITY, CONTROLLER_PRIORITY = 60, 40
TRIES = 2
NAME = "demo"
VIEWER = "viewer"
PAGE = "open in a browser: "
LEADING = ("trajectory", "recorder")  # nodes without which no experiment is worth its time
DISCOVERY_TIME_S = 2.0  # in which nodes that are there already are found
ANSWER_TIMEOUT_S = 10.0
Say = Callable[[str], None]


class Onlooker:
    """A node that sees when the others are ready."""

    def __init__(self, domain: int):
        self._domain = domain
        self._context = Context()
        rclpy.init(
            context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO
        )
        self.node = Node(NAME, context=self._context)
        self.executor = KeptExecutor(context=self._context)
        self.executor.add_node(self.node)
        self.driver = DriverClient(self.node)

    def ready(self, listeners: Collection[str]) -> bool:
        """Whether these nodes listen to the driver, and it could be enabled.

        That a node says it is ready is not enough: the recorder takes up a topic when it finds it.
        While five processes start at once, frames may come late: such faults are reset.
        """
        self.executor.spin_once(timeout_sec=0.1)
        found = self.node.get_subscriptions_info_by_topic(JOINT_STATES.name)
        if not {one.node_name for one in found} >= set(listeners):
            return False
        state = self.driver.state.state
        if state == DriverState.STATE_FAULT and self.driver.ready:
            answer = self.driver.reset_fault()
            self.executor.spin_until_future_complete(answer, timeout_sec=ANSWER_TIMEOUT_S)
        return state == DriverState.STATE_DISABLED

    def __enter__(self) -> Self:
        end = time.monotonic() + DISCOVERY_TIME_S
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)
        if others := [name for name in self.node.get_node_names() if name not in (NAME, VIEWER)]:
            raise DemoError(
                f"ROS domain {self._domain} is not empty: {', '.join(others)}; start the demo again"
            )
        return self

    def __exit__(self, *_: object) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


def record(suite: Processes, domain: int, law: Law, seed: int, say: Say) -> None:
    """The bags of `law`, recorded live, and the identification node's model beside them.

    `DemoError` if a process fails or an experiment ends early, twice.
    """
    with Onlooker(domain) as onlooker:
        say("starting: simulated crane, driver, trajectory, identification, recorder")
        start(suite, law, seed)
        suite.start(
            *("identification", "crane_identification", "identification", "--ros-args"),
            *("-p", f"machine:={law.machine}"),
        )
        _experiment(
            suite, onlooker, law, "train", EXCITATION, FIT_PERIODS, (*LEADING, "identification")
        )
        suite.stop("identification")
        say("a second, other motion, for validation")
        _experiment(suite, onlooker, law, "validate", VALIDATION, VALIDATION_PERIODS, LEADING)
        stop(suite)


def show(suite: Processes, law: Law) -> str:
    """Show what the topics tell in a browser; where."""
    suite.start(
        *(VIEWER, "crane_viewer", "viewer", "--machine", law.machine),
        *("--web-port", 0, "--data-port", 0),
    )
    found: list[str] = []

    def opened() -> bool:
        found[:] = re.findall(f"^{PAGE}(.+)$", suite.said(VIEWER), re.MULTILINE)
        return bool(found)

    suite.until(opened, "the viewer does not open its page")
    return found[0]


def follow(suite: Processes, domain: int, law: Law, seed: int, controller: str, say: Say) -> None:
    """The motion that the model was fitted to once more, led by a controller that uses the model.

    Recorded as the bag "follow". `DemoError` as `record`.
    """
    with Onlooker(domain) as onlooker:
        say(f"the motion of the fit again, led by the fitted model: {controller}")
        start(suite, law, seed, "-p", f"law:={controller}", "-p", f"model:={law.fitted}")
        _experiment(suite, onlooker, law, "follow", EXCITATION, FOLLOW_PERIODS, LEADING)
        stop(suite)


def start(suite: Processes, law: Law, seed: int, *leading: str, plant: Path | None = None) -> None:
    """Simulated crane, driver, and the trajectory node, `leading` its further arguments.

    The crane is that of the law, or a `plant` file's, and takes lines of an operator.
    """
    port = _free_port()
    suite.start(
        *("crane", "crane_sim", "simulated_crane", "--bus-option", f"port={port}", "--operator"),
        *("--machine", law.machine, "--plant", plant or law.plant, "--seed", seed),
        stdin=subprocess.PIPE,
        priority=MACHINE_PRIORITY,
    )
    suite.start(
        *("driver", "crane_driver", "driver", "--ros-args"),
        *("-p", f"machine:={law.machine}", "-p", f"bus.options:=port={port}"),
    )
    suite.start(
        *("trajectory", "crane_trajectory", "trajectory", "--ros-args"),
        *("-p", f"machine:={law.machine}", *leading),
        priority=CONTROLLER_PRIORITY,
    )


def stop(suite: Processes) -> None:
    """The same."""
    for name in ("trajectory", "driver", "crane"):
        suite.stop(name)


def _experiment(
    suite: Processes,
    onlooker: Onlooker,
    law: Law,
    use: str,
    trajectory: str,
    periods: int,
    listeners: Collection[str],
) -> None:
    """One recorded experiment; once more if it ended early, as it may on a busy computer."""
    bag = law.bag(use)
    for attempt in range(TRIES):
        suite.start("recorder", "crane_nodes", "recorder", "--out", bag)
        suite.until(lambda: onlooker.ready(listeners), "the nodes do not find each other")
        status = suite.attend(
            *("excitation", "crane_trajectory", "run_excitation", "--enable"),
            *("--trajectory", law.file(trajectory), "--periods", periods),
            *("--result", law.result(use), "--replace"),
        )
        suite.stop("recorder")
        if status == 0:
            return
        bag.rename(bag.with_name(f"{use}_ended_early_{attempt}"))
    raise DemoError(f"the experiment '{use}' ended early {TRIES} times; the lines above say why")


def own_domain() -> int:
    """A ROS domain for this demo: never the user's, in which a real crane may be."""
    domain = 1 + os.getpid() % DOMAINS
    return domain if str(domain) != os.environ.get("ROS_DOMAIN_ID") else 1 + domain % DOMAINS


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
