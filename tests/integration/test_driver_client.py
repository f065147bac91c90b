"""A driver with another name in a namespace, and all that must find it; its process is real."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import rclpy
from integration.processes import (
    DRIVER,
    IMPATIENT,
    MACHINE,
    PATIENCE,
    SIMULATED_TIME,
    end,
    free_port,
    start,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from crane_driver.operator.bringup.crane_client import CraneClient
from crane_driver.operator.jog.jog_node import Jog
from crane_interfaces.msg import DriverState
from crane_nodes import DriverClient
from crane_nodes.driver_client import DRIVER_SILENCE_S
from crane_nodes.managed import Stop
from crane_trajectory.run_excitation_node import RunExcitationClient
from crane_trajectory.trajectory_node import Trajectory

NAME = "/left/left_driver"


class Crane:
    """The machine and its driver, and a node that works until something holds."""

    def __init__(self) -> None:
        port = free_port()
        self.port = str(port)
        self.machine = start(MACHINE, "--bus-option", f"port={port}", "--lock-step")
        self.driver = start(
            *(IMPATIENT + DRIVER, "--ros-args", "-r", "__node:=left_driver", "-r", "__ns:=/left"),
            *("-p", f"bus.options:=port={port}", *SIMULATED_TIME),
        )
        self.node = Node("watcher")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.client = DriverClient(self.node)
        self.until(lambda: self.client.ready)

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; {self.client.problem}"
            self._executor.spin_once(timeout_sec=0.05)

    @contextmanager
    def working(self, node: Node) -> Iterator[None]:
        """Another node works with it."""
        self._executor.add_node(node)
        yield
        self._executor.remove_node(node)

    def in_state(self, state: int) -> DriverState:
        self.until(lambda: self.client.state.state == state)
        return self.client.state

    def disabled(self) -> None:
        """At rest and well."""

        def well() -> bool:
            future = self.client.reset_fault()
            self.until(future.done)
            return self.client.state.state == DriverState.STATE_DISABLED

        self.until(well)

    def close(self) -> None:
        for process in (self.driver, self.machine):
            end(process)
        self._executor.shutdown()
        self.node.destroy_node()


@pytest.fixture(scope="module")
def crane(ros_domain: int) -> Iterator[Crane]:
    arguments = ["--ros-args", "-r", "__ns:=/left"]
    rclpy.init(args=arguments, domain_id=ros_domain)
    one = Crane()
    yield one
    one.close()
    rclpy.shutdown()


def test_whoever_joins_late_is_told_the_state_that_was_published_before(crane: Crane) -> None:
    crane.disabled()
    told: list[DriverState] = []
    before = crane.client.newest.header.stamp
    DriverClient(crane.node, told.append)
    crane.until(lambda: told)
    assert told[0].header.stamp == before
    assert told[0].node == NAME


def test_it_is_enabled_and_stopped_by_its_state_and_services(crane: Crane) -> None:
    crane.disabled()
    answer = crane.client.enable()
    crane.until(answer.done)
    assert answer.result().success
    assert crane.in_state(DriverState.STATE_ENABLED).cause == ""
    crane.until(lambda: crane.client.problem == "")
    crane.client.stop()
    state = crane.in_state(DriverState.STATE_EMERGENCY_STOP)
    crane.until(lambda: crane.client.problem == f"{NAME}: {state.cause}; {state.remedy}")


def test_a_fault_is_told_at_once_with_cause_and_remedy(crane: Crane) -> None:
    crane.disabled()
    os.kill(crane.machine.pid, signal.SIGSTOP)
    try:
        state = crane.in_state(DriverState.STATE_FAULT)
    finally:
        os.kill(crane.machine.pid, signal.SIGCONT)
    assert state.fault in (DriverState.FAULT_LATE, DriverState.FAULT_MISSING)
    assert state.source in state.cause
    assert state.remedy.endswith("then call reset_fault")


def test_bring_up_and_jog_find_it(crane: Crane) -> None:
    bringup = CraneClient(Stop())
    bringup.connect()
    time.sleep(1.1 * DRIVER_SILENCE_S)  # held up, by other processes say, it hears of no driver
    assert bringup.parameters(["bus.options"]) == {"bus.options": f"port={crane.port}"}
    bringup.destroy_node()
    jog = Jog(by_joystick=False)
    jog.begin(Stop())

    def found() -> bool:
        jog.work()
        return jog.shown().state != "no driver"

    crane.until(found)
    jog.stop()
    jog.destroy_node()


def test_trajectory_and_its_client_find_it(crane: Crane) -> None:
    node = Trajectory()
    node.trigger_configure()
    node.trigger_activate()
    with crane.working(node):
        crane.until(lambda: node.lacking().startswith(f"{NAME}: "))  # once it is seen at rest
    node.trigger_shutdown()
    node.destroy_node()
    client = RunExcitationClient(Stop())

    crane.disabled()
    with client.enabled():
        pass
    client.destroy_node()


def test_a_driver_that_ends_says_so(crane: Crane) -> None:
    crane.driver.send_signal(signal.SIGTERM)
    crane.until(lambda: crane.client.newest.state == DriverState.STATE_FINALIZED)
    assert crane.client.state.text == "no driver"
