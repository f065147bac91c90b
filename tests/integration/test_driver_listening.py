"""A driver that only listens: what it tells, and that it sends nothing whatever it is asked."""

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from integration.processes import DRIVER, PATIENCE, end, free_port, start
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_driver import BusSettings, DriverCodec, Link, MachineCodec, load_layout
from crane_driver.driver_node import main
from crane_interfaces.msg import DriverState, ValveCommand
from crane_interfaces.srv import SubstituteEncoder
from crane_model import load_machine
from crane_model.machine_files import machine_file

MACHINE = load_machine()
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OPENING = 0.25  # of the telescope's valve, by whoever commands the crane


class Place:
    """A bus with a crane and its own controller, both played by the test, and the listener."""

    def __init__(self) -> None:
        port = free_port()
        self.link = Link(BusSettings(extra={"port": port})).open()
        layout = load_layout(MACHINE, machine_file("can.yaml"), machine_file("can.dbc"))
        self._machine, self._controller = MachineCodec(layout), DriverCodec(layout)
        self._cycle, self._due = min(self._machine.cycles.values()), time.monotonic()  # s
        self.driver = start(
            DRIVER,
            *("--ros-args", "-p", f"bus.options:=port={port}", "-p", "listen_only:=true"),
            *("-p", "realtime.priority:=0", "-p", "realtime.lock_memory:=false"),
        )
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = Node("watcher", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.heard: dict[str, Any] = {}
        for kind, topic, depth in (
            (JointState, "joint_states", 10),
            (ValveCommand, "valve_output", 10),
            (DriverState, "driver/state", LATCHED),
            (DiagnosticArray, "/diagnostics", 10),
        ):
            self.node.create_subscription(kind, topic, self._keep(topic), depth)

    def _keep(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self.heard[topic] = message

        return keep

    def until(self, condition: Callable[[], object]) -> None:
        """Let the crane and its controller talk until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self.heard
            self._executor.spin_once(timeout_sec=0.0)
            if time.monotonic() < self._due:
                continue
            self._due += self._cycle
            frames = self._controller.command_frames({"telescope": OPENING}, enabled=True)
            positions = {"slew": 0.0, "inner_boom": 0.5, "outer_boom": -1.0, "telescope": 0.3}
            pressures = dict.fromkeys(self._machine.layout.pressures, 5e6)
            states = {"valve_unit": "Enabled"}
            frames += [
                self._machine.reading_frame(name, positions, pressures, states)
                for name in self._machine.cycles
            ]
            for frame in frames:
                self.link.send(frame)

    def call(self, kind: type[Any], service: str, request: Any) -> tuple[bool, str]:
        client = self.node.create_client(kind, f"driver/{service}")
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result().success, future.result().message

    def close(self) -> None:
        end(self.driver)
        self.link.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def place(ros_domain: int) -> Iterator[Place]:
    one = Place()
    yield one
    one.close()


def test_a_listener_publishes_refuses_and_sends_nothing(place: Place) -> None:
    place.until(lambda: {"joint_states", "valve_output", "driver/state"} <= place.heard.keys())
    state = place.heard["driver/state"]
    assert (state.state, state.text) == (DriverState.STATE_LISTENING, "listening")
    assert "parameter listen_only" in state.cause
    for service in ("enable", "disable", "emergency_stop"):
        done, said = place.call(Trigger, service, Trigger.Request())
        assert not done
        assert "the driver only listens (parameter listen_only): it sends nothing" in said, service
    done, said = place.call(
        SubstituteEncoder, "substitute", SubstituteEncoder.Request(joint="telescope")
    )
    assert not done
    assert "only listens" in said
    assert place.call(Trigger, "reset_fault", Trigger.Request()) == (True, "listening")

    def opened() -> float:
        output = place.heard["valve_output"]
        return output.command[output.name.index("telescope")]

    place.until(lambda: opened() == OPENING and "/diagnostics" in place.heard)
    shown = {one.name: one for one in place.heard["/diagnostics"].status}
    assert "listening; the driver only listens" in shown["driver: safety"].message
    assert place.node.count_subscribers("valve_command") == 0
    end(place.driver)
    assert not place.link.take(), "the listener has sent frames"


def test_a_listener_is_not_for_simulated_time(
    ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    given = ["--ros-args", "-p", "listen_only:=true", "-p", "use_sim_time:=true"]
    assert main([*given, "-p", f"bus.options:=port={free_port()}"]) == 1
    out, err = capfd.readouterr()
    assert "listen_only and use_sim_time are both true" in out + err
