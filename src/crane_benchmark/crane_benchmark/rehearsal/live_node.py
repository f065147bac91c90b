"""The suite as processes around a simulated crane on a CAN bus, and a node that watches them."""

import os
import random
import socket
import subprocess
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Self

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from crane_bags.types import JOINT_STATES
from crane_benchmark.rehearsal.crane_run import EXCITATION, WARM_S, CraneRun
from crane_benchmark.rehearsal.processes import READY_TIMEOUT_S, ProcessError, Processes
from crane_interfaces.msg import DriverState
from crane_nodes.driver_client import DriverClient
from crane_nodes.executor import KeptExecutor
from crane_nodes.node_time import NodeTime

# As docs/how_to/real_time.md has them; the driver asks for 50.
MACHINE_PRIORITY, CONTROLLER_PRIORITY = 60, 40
FOLLOW_PERIODS = 1
NAME = "onlooker"
VIEWER = "viewer"
LEADING = ("trajectory", "recorder")  # nodes without which no experiment is worth its time
DISCOVERY_TIME_S = 2.0  # in which nodes that are there already are found
ANSWER_TIMEOUT_S = 10.0
Say = Callable[[str], None]


class Onlooker:
    """A node that sees when the others are ready."""

    def __init__(self, suite: Processes, domain: int):
        self._suite, self._domain = suite, domain
        self._context = Context()
        rclpy.init(
            context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO
        )
        simulated = Parameter("use_sim_time", value=suite.simulated)
        self.node = Node(NAME, context=self._context, parameter_overrides=[simulated])
        self.clock = NodeTime(self.node)
        self.clock.listen()
        self.executor = KeptExecutor(context=self._context)
        self.executor.add_node(self.node)
        self.driver = DriverClient(self.node)
        self.patience = READY_TIMEOUT_S if suite.simulated else ANSWER_TIMEOUT_S  # s

    def lacking(self, listeners: Collection[str]) -> str:
        """Name the nodes that do not listen to the driver yet, or why it could not be enabled.

        That a node says it is ready is not enough: the recorder takes up a topic when it finds it.
        """
        self.executor.spin_once(timeout_sec=0.1)
        found = self.node.get_subscriptions_info_by_topic(JOINT_STATES.name)
        if absent := set(listeners) - {endpoint.node_name for endpoint in found}:
            return f"{', '.join(sorted(absent))} do not listen to the driver yet"
        state = self.driver.state
        if state.state == DriverState.STATE_DISABLED:
            return ""
        return f"driver: {state.text}; {state.cause}; {state.remedy}"

    def settled(self, listeners: Collection[str]) -> DriverState:
        """Wait until these nodes listen to a driver that can be enabled, or is in a fault again.

        While they all start at once, frames may come late: the first fault is reset.
        """
        faults = 0

        def settled() -> bool:
            nonlocal faults
            lacking = self.lacking(listeners)
            if self.driver.state.state == DriverState.STATE_FAULT and self.driver.ready:
                faults += 1
                if faults == 1:
                    answer = self.driver.reset_fault()
                    self.executor.spin_until_future_complete(answer, self.patience)
            return not lacking or faults > 1

        self._suite.until(settled, lambda: self.lacking(listeners))
        return self.driver.newest

    def ready(self, listeners: Collection[str]) -> None:
        """Wait until these nodes listen to a driver that can be enabled; else `ProcessError`."""
        if self.settled(listeners).state == DriverState.STATE_FAULT:
            raise self._suite.failed(self.lacking(listeners), "driver")

    def __enter__(self) -> Self:
        end = time.monotonic() + DISCOVERY_TIME_S
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.1)
        if others := [name for name in self.node.get_node_names() if name not in (NAME, VIEWER)]:
            raise ProcessError(
                f"ROS domain {self._domain} is not empty: {', '.join(others)}; start again"
            )
        return self

    def __exit__(self, *_: object) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


def follow(suite: Processes, domain: int, run: CraneRun, seed: int, say: Say) -> None:
    """The motion that the model was fitted to once more, led by a controller that uses the model.

    Recorded as the bag "follow". `ProcessError` as `experiment`.
    """
    with Onlooker(suite, domain) as onlooker:
        say(f"the first motion, controlled by the fitted model ({run.controller})")
        led = ("-p", f"law:={run.controller}", "-p", f"model:={run.fitted}")
        start(suite, run, seed, *led, listeners=LEADING)
        experiment(suite, onlooker, run, "follow", EXCITATION, FOLLOW_PERIODS, LEADING)
        stop(suite)


def start(
    suite: Processes,
    run: CraneRun,
    seed: int,
    *leading: str,
    listeners: Collection[str],
    plant: Path | None = None,
) -> None:
    """Start simulated crane, driver, and trajectory node, `leading` its further arguments.

    The crane is that of the run, or a `plant` file's, and takes lines of an operator. Simulated
    time begins when all `listeners` are there.
    """
    port = start_crane(suite, run, seed, plant)
    start_driver(suite, run, port, "-p", f"simulated_time.listeners:={' '.join(listeners)}")
    suite.start(
        *("trajectory", "crane_trajectory", "trajectory", "--ros-args"),
        *("-p", f"machine:={run.machine}", *leading, *suite.clock),
        *([] if suite.simulated else ["-p", f"realtime.priority:={CONTROLLER_PRIORITY}"]),
    )


def start_crane(suite: Processes, run: CraneRun, seed: int, plant: Path | None = None) -> int:
    """Start the simulated crane alone, at operating temperature, and return the port of its bus."""
    port = free_port()
    suite.start(
        *("crane", "crane_sim", "simulated_crane", "--bus-option", f"port={port}", "--operator"),
        *("--machine", run.machine, "--plant", plant or run.plant, "--seed", seed),
        *("--running", WARM_S),
        *(["--lock-step"] if suite.simulated else ["--priority", MACHINE_PRIORITY]),
        *("--dbc", suite.dbc or run.file("can.dbc")),
        stdin=subprocess.PIPE,
    )
    return port


def start_driver(suite: Processes, run: CraneRun, port: int, *parameters: str) -> None:
    """Start the driver on the bus of a simulated crane."""
    suite.start(
        *("driver", "crane_driver", "driver", "--ros-args"),
        *("-p", f"machine:={run.machine}", "-p", f"bus.options:=port={port}", *suite.clock),
        *("-p", f"dbc:={suite.dbc or run.file('can.dbc')}", *parameters),
    )


def stop(suite: Processes) -> None:
    """Stop what `start` has started."""
    for name in ("trajectory", "driver", "crane"):
        suite.stop(name)


def experiment(
    suite: Processes,
    onlooker: Onlooker,
    run: CraneRun,
    use: str,
    trajectory: str,
    periods: int,
    listeners: Collection[str],
) -> None:
    """Record one experiment. `ProcessError` if a process fails or the experiment ends early."""
    record_to(suite, run.bag(use))
    onlooker.ready(listeners)
    status = suite.attend(
        *("excitation", "crane_trajectory", "run_excitation", "--enable"),
        *("--trajectory", run.file(trajectory), "--periods", periods),
        *("--result", run.result(use), "--replace", "--ros-args", *suite.clock),
    )
    suite.stop("recorder")
    if status:
        raise suite.failed(f"the experiment '{use}' ended early; the lines above say why", "driver")


def start_identification(suite: Processes, run: CraneRun) -> None:
    """Start the node that fits the model online."""
    suite.start(
        *("identification", "crane_identification", "identification", "--ros-args"),
        *("-p", f"machine:={run.machine}", *suite.clock),
    )


def record_to(suite: Processes, bag: Path) -> None:
    """Start a recorder."""
    suite.start("recorder", "crane_nodes", "recorder", "--out", bag, "--ros-args", *suite.clock)


def foreign_domain() -> int:
    """A ROS domain that is not the user's, in which a real crane may be."""
    users_domain = os.environ.get("ROS_DOMAIN_ID", "0")
    return random.choice([domain for domain in range(1, 101) if str(domain) != users_domain])


def free_port() -> int:
    """Return a UDP port that no process uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
