"""Simulated crane and driver as processes; the test watches their bus and their topics."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from integration.commander import Commander
from integration.matched import wait_until_heard
from integration.patient_files import patient_mapping
from integration.processes import DRIVER, MACHINE, PATIENCE, end, free_port, start
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
from crane_model.machine import load_machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_nodes.polled import Polled

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEEP = QoSProfile(depth=2000)  # messages, while a busy test machine does not take them
FRAMES = 50_000  # of the bus, for the same reason: 40 s of them
SERVICES = ("enable", "disable", "emergency_stop", "reset_fault")


def made(message: Any) -> float:
    """When, by the stamp of its header [s]."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


class Valves(NamedTuple):
    """One valve frame on the bus."""

    steady: float  # s
    stamp: int  # ns
    commands: dict[str, float]
    enabled: bool


class Stage:
    """What runs, what it says, and what passes on the bus."""

    def __init__(
        self,
        folder: Path,
        pose: list[str],
        canopen: Mapping[str, object] = {},
        safety: str = "",
        driver: str = DRIVER,
        namespace: str = "",
        machine: str = DEFAULT_MACHINE,
        operator: bool = False,
        plant: Path | None = None,
    ):
        path = self.mapping = patient_mapping(folder, canopen, machine)
        port = self.port = free_port()
        self.layout = load_layout(load_machine(machine), path, machine_file("can.dbc", machine))
        self.codec = MachineCodec(self.layout)
        self._reader = DriverCodec(self.layout)
        self.link = Link(BusSettings(extra={"port": port}), capacity=FRAMES).open()
        posed = [*(["--operator"] if operator else []), *(["--pose", *pose] if pose else [])]
        posed += ["--plant", str(plant)] if plant else []
        self.machine = start(MACHINE, "--machine", machine, "--bus-option", f"port={port}", *posed)
        options = {"bus.options": f"port={port}", "mapping": str(path), "safety": f"'{safety}'"}
        options["machine"] = machine
        parameters = [one for name, value in options.items() for one in ("-p", f"{name}:={value}")]
        self.remapping = ["-r", f"__ns:=/{namespace}"] if namespace else []
        self.arguments = ["--ros-args", *self.remapping, *parameters]
        self.driver = start(driver, *self.arguments)
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = Node("watcher", context=self.context, namespace=namespace)
        self._safety = f"{namespace}/driver: safety".lstrip("/")
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients = {
            name: self.node.create_client(Trigger, f"driver/{name}") for name in SERVICES
        }
        self.states: list[JointState] = []
        self.pressures: list[CylinderPressures] = []
        self.diagnostics: dict[str, tuple[bytes, str, dict[str, str]]] = {}
        self.reported = 0  # ns, when the driver made its last report
        self.encoders: dict[str, float] = {}  # rad, m: as the machine sends them
        self.encoded: dict[str, float] = {}  # s, steady: when they came
        self.frames: list[Frame] = []  # of the machine
        self.machine_state = ""  # what the valve unit says of itself
        self.valves: list[Valves] = []
        self.description: list[str] = []
        self._topics: list[tuple[Polled, Callable[[Any], object]]] = []
        self.listen(JointState, "joint_states", self.states.append)
        self.listen(CylinderPressures, "cylinder_pressures", self.pressures.append)
        self.listen(DiagnosticArray, "/diagnostics", self._diagnosed)
        self.node.create_subscription(
            String, "robot_description", lambda message: self.description.append(message.data),
            LATCHED,
        )  # fmt: skip
        try:
            self.until(lambda: self.states and self.valves and self.pressures)
            self._know_driver()
        except AssertionError:
            self.close()  # a driver that is left behind talks into the tests to come
            raise

    def listen(self, kind: type[Any], topic: str, told: Callable[[Any], object]) -> None:
        """Tell of every message. They come from the queue: through the executor, those of a crane
        would take as much computing as the crane itself.
        """
        self._topics.append((Polled(self.node, kind, topic, DEEP), told))

    def start_driver(self, program: str = DRIVER) -> None:
        """Another driver in the place of one that has ended."""
        assert self.driver.poll() is not None
        self.driver = start(program, *self.arguments)
        self.diagnostics.clear()
        states, valves = len(self.states), len(self.valves)
        self.until(lambda: len(self.states) > states and len(self.valves) > valves)
        self._know_driver()

    def _know_driver(self) -> None:
        """It has reported, and it has found who calls it: else an answer may be lost."""
        self.until(lambda: self._safety in self.diagnostics)
        self.until(lambda: all(one.service_is_ready() for one in self._clients.values()))
        wait_until_heard(self.node, "driver", self.until)

    def close(self) -> None:
        for process in (self.driver, self.machine):
            end(process)
        self.link.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, condition: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Work until a condition holds; the seconds bound a test that fails."""
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; {self.diagnostics}"
            self.spin()

    def measured(self, condition: Callable[[JointState], bool] = lambda state: True) -> JointState:
        """A joint state made after this call for which the condition holds; the newest one of a
        busy test machine may have been taken seconds ago.
        """
        called = time.time()
        self.until(lambda: made(self.states[-1]) > called and condition(self.states[-1]))
        return self.states[-1]

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.01)
        for topic, told in self._topics:
            for message, _ in topic.take():
                told(message)
        for frame in self.link.take():
            readings = self.codec.decode(frame)
            if readings is None:
                self.frames.append(frame)
                answer = self._reader.decode(frame)
                positions = answer.positions if answer else {}
                self.encoders |= positions
                self.encoded |= dict.fromkeys(positions, frame.steady)
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

    @property
    def safety(self) -> tuple[str, dict[str, str]]:
        """Message and values of the last report on safety; a new state is reported at once."""
        _, message, values = self.diagnostics[self._safety]
        return message, values

    def report(self) -> tuple[str, dict[str, str]]:
        """What a report on safety says that was made after this call."""
        called = time.time_ns()
        self.until(lambda: self.reported > called)
        return self.safety

    def disabled(self) -> Self:
        """The crane at rest, well, and disabled."""

        def well() -> bool:
            return self.safety[1]["state"] == "disabled"

        self.call("disable")
        self.until(lambda: not self.valves[-1].enabled)
        # a fault that goes on comes back
        self.until(lambda: self.call("reset_fault")[0] and self.within(well, 1.0))
        return self

    def enabled(self) -> Self:
        """Enabled, with a publisher of neutral commands."""

        def tried() -> bool:
            self.disabled()
            enabled, _ = self.call("enable")  # refused until the neutral commands have arrived
            return enabled and self.within(lambda: self.valves[-1].enabled, 1.0)

        self.until(tried)
        return self

    def heard(self, commander: Commander, **commands: float) -> None:
        """The driver hears these commands, which are not neutral: that is why it is not enabled."""
        commander.send(**commands)

        def refused() -> bool:
            self.disabled()
            enabled, why = self.call("enable")
            return not enabled and "command neutral first" in why

        self.until(refused)

    def moving(self, commander: Commander, **commands: float) -> Self:
        """Enabled, and the commands at the valves, from where limits may hold them back."""

        def arrived(since: int) -> bool:
            return any(
                one.enabled
                and all(
                    abs(one.commands[joint] - value) < 1e-3 for joint, value in commands.items()
                )
                for one in self.valves[since:]
            )

        def tried() -> bool:
            self.heard(commander, **commands)  # else it may be enabled before neutral ones come
            commander.send(**dict.fromkeys(commands, 0.0))
            self.enabled()
            since = len(self.valves)
            commander.send(**commands)
            self.within(lambda: arrived(since) or not self.valves[-1].enabled)
            return arrived(since)

        self.until(tried)  # again after a true fault, as a busy test machine makes them
        return self

    def moved(self, commander: Commander, there: Callable[[], bool], **commands: float) -> Self:
        """The commands at the valves until the crane is there, however often a true fault stops it,
        as a busy test machine makes them.
        """

        def tried() -> bool:
            self.moving(commander, **commands)
            self.until(lambda: there() or not self.valves[-1].enabled)
            return there()

        self.until(tried)
        return self

    def within(self, condition: Callable[[], bool], seconds: float = 5.0) -> bool:
        """Whether a condition comes to hold within a time."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            self.spin()
        return condition()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for one in message.status:
            values = {pair.key: pair.value for pair in one.values}
            self.diagnostics[one.name] = (one.level, one.message, values)
            if one.name == self._safety:
                stamp = message.header.stamp
                self.reported = stamp.sec * 10**9 + stamp.nanosec


@contextmanager
def commander(stage: Stage) -> Iterator[Commander]:
    """A publisher of commands, and none after it."""
    process = Commander("--ros-args", *stage.remapping)
    try:
        stage.until(lambda: stage.node.count_publishers("valve_command") == 1)
        yield process
    finally:
        process.end()
        stage.until(lambda: stage.node.count_publishers("valve_command") == 0)
