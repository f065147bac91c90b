"""Simulated crane, driver and a publisher of commands as processes; the test watches their bus."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Self

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusSettings
from crane_driver.can.codec import DriverCodec, MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.link import Link
from crane_interfaces.msg import CylinderPressures
from crane_model.configuration import packaged

PATIENCE = 120.0  # s, bounds a failing test; a passing one ends with its condition
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SERVICES = ("enable", "disable", "emergency_stop", "reset_fault")
# A busy test machine is late by itself: here frames may come much later than on a real bus.
TIMING = {"late": 200, "missing": 300, "lost": 2}

RUN = "import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"
DRIVER = RUN.format(module="crane_driver.driver_node")
MACHINE = RUN.format(module="crane_sim.simulated_crane")
COMMANDER = """
import json, sys, threading, time, rclpy
from rclpy.node import Node
from crane_interfaces.msg import ValveCommand
command = {}
done = threading.Event()
def read():
    global command
    for line in sys.stdin:
        command = json.loads(line)
    done.set()
threading.Thread(target=read, daemon=True).start()
rclpy.init()
node = Node("commander")
publisher = node.create_publisher(ValveCommand, "/valve_command", 10)
while not done.is_set():
    now = command
    if now is not None:
        message = ValveCommand(name=list(now), command=[float(v) for v in now.values()])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)
    time.sleep(0.01)
rclpy.shutdown()
"""


class Valves(NamedTuple):
    """One valve frame on the bus."""

    steady: float  # s
    stamp: int  # ns
    commands: dict[str, float]
    enabled: bool


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def line(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", program, *arguments]


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


def start(program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        line(program, *arguments),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )


def end(process: subprocess.Popen[str], number: int = signal.SIGTERM) -> int:
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.send_signal(number)
    try:
        return process.wait(30.0)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


class Commander:
    """A process that publishes commands at 100 Hz."""

    def __init__(self) -> None:
        self.process = start(COMMANDER)
        self.send()

    def send(self, **commands: float) -> None:
        self._tell(commands)

    def pause(self) -> None:
        """Stay there as a publisher, but publish nothing."""
        self._tell(None)

    def end(self) -> None:
        """Leave the graph: one that is killed is missed by others only after 20 s."""
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait(PATIENCE)

    def _tell(self, what: object) -> None:
        assert self.process.stdin
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()


class Stage:
    """What runs, what it says, and what passes on the bus."""

    def __init__(
        self,
        folder: Path,
        pose: list[str],
        canopen: Mapping[str, object] = {},
        safety: str = "",
        driver: str = DRIVER,
    ):
        mapping = yaml.safe_load(packaged("crane_driver", "laboratory_crane_can.yaml").read_text())
        path = folder / "mapping.yaml"
        path.write_text(yaml.safe_dump({**mapping, "timing": TIMING, "canopen": dict(canopen)}))
        port = self.port = free_port()
        self.layout = load_layout(path)
        self.codec = MachineCodec(self.layout)
        self._reader = DriverCodec(self.layout)
        self.link = Link(BusSettings(extra={"port": port})).open()
        posed = ["--pose", *pose] if pose else []
        self.machine = start(MACHINE, "--bus-option", f"port={port}", *posed)
        options = {"bus.options": f"port={port}", "mapping": str(path), "safety": f"'{safety}'"}
        parameters = [one for name, value in options.items() for one in ("-p", f"{name}:={value}")]
        self._arguments = ["--ros-args", *parameters]
        self.driver = start(driver, *self._arguments)
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = Node("watcher", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients = {
            name: self.node.create_client(Trigger, f"/driver/{name}") for name in SERVICES
        }
        self.states: list[JointState] = []
        self.pressures: list[CylinderPressures] = []
        self.diagnostics: dict[str, tuple[bytes, str, dict[str, str]]] = {}
        self.reports = 0
        self.frames: list[Frame] = []  # of the machine
        self.machine_state = ""  # what the valve unit says of itself
        self.valves: list[Valves] = []
        self.description: list[str] = []
        node = self.node
        node.create_subscription(JointState, "/joint_states", self.states.append, 10)
        node.create_subscription(
            CylinderPressures, "/cylinder_pressures", self.pressures.append, 10
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        node.create_subscription(
            String, "/robot_description", lambda message: self.description.append(message.data),
            LATCHED,
        )  # fmt: skip
        self.until(lambda: self.states and self.valves and self.pressures)
        self.until(lambda: all(one.service_is_ready() for one in self._clients.values()))

    def start_driver(self, program: str = DRIVER) -> None:
        """Another driver in the place of one that has ended."""
        assert self.driver.poll() is not None
        self.driver = start(program, *self._arguments)
        states, valves = len(self.states), len(self.valves)
        self.until(lambda: len(self.states) > states and len(self.valves) > valves)

    def close(self) -> None:
        for process in (self.driver, self.machine):
            end(process)
        self.link.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, condition: Callable[[], object]) -> None:
        """Work until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; {self.diagnostics}"
            self.spin()

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.01)
        for frame in self.link.take():
            readings = self.codec.decode(frame)
            if readings is None:
                self.frames.append(frame)
                answer = self._reader.decode(frame)
                if answer and answer.states:
                    self.machine_state = answer.states["valve_unit"]
            elif readings.commands:
                self.valves.append(
                    Valves(
                        readings.steady, readings.stamp, readings.commands, bool(readings.enabled)
                    )
                )

    def call(self, service: str) -> tuple[bool, str]:
        future = self._clients[service].call_async(Trigger.Request())
        self.until(future.done)
        answer = future.result()
        return answer.success, answer.message

    def safety(self) -> tuple[str, dict[str, str]]:
        """Message and values of a report on safety that is newer than this call."""
        before = self.reports
        self.until(lambda: self.reports > before + 1)
        _, message, values = self.diagnostics["driver: safety"]
        return message, values

    def disabled(self) -> Self:
        """The crane at rest, well, and disabled."""
        self.call("disable")
        self.until(lambda: not self.valves[-1].enabled)
        # a fault that goes on comes back
        self.until(lambda: self.call("reset_fault")[0] and self.safety()[0] == "disabled")
        return self

    def enabled(self) -> Self:
        """Enabled, with a publisher of neutral commands."""

        def tried() -> bool:
            self.disabled()
            self.call("enable")
            return self.valves[-1].enabled or self.within(lambda: self.valves[-1].enabled)

        self.until(tried)
        return self

    def moving(self, commander: Commander, **commands: float) -> Self:
        """Enabled, and the commands at the valves."""

        def arrived() -> bool:
            last = self.valves[-1]
            return last.enabled and all(
                abs(last.commands[joint] - value) < 1e-3 for joint, value in commands.items()
            )

        for _ in range(5):  # a test machine that is too busy makes true faults
            commander.send(slew=0.0)
            self.enabled()
            commander.send(**commands)
            if self.within(arrived):
                return self
        raise AssertionError(f"not moving; {self.diagnostics}")

    def within(self, condition: Callable[[], bool], seconds: float = 5.0) -> bool:
        """Whether a condition comes to hold within a time."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            self.spin()
        return condition()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        self.reports += 1
        for one in message.status:
            values = {pair.key: pair.value for pair in one.values}
            self.diagnostics[one.name] = (one.level, one.message, values)


@contextmanager
def commander(stage: Stage) -> Iterator[Commander]:
    """A publisher of commands, and none after it."""
    process = Commander()
    try:
        stage.until(lambda: stage.node.count_publishers("/valve_command") == 1)
        yield process
    finally:
        process.end()
        stage.until(lambda: stage.node.count_publishers("/valve_command") == 0)
