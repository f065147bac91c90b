"""Simulated crane and driver as processes; the test watches their bus and their topics.

They run on simulated time, which waits for the test: the crane goes no further than `AHEAD` beyond
what the test has taken. So a test must `spin` while it waits for anything that takes time.
"""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from integration.commander import Commander
from integration.matched import wait_until_heard
from integration.patient_files import mapping_file, patient_safety
from integration.processes import (
    DRIVER,
    MACHINE,
    PATIENCE,
    SIMULATED_TIME,
    URGENT_MACHINE,
    end,
    free_port,
    start,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from crane_driver import BusSettings, DriverCodec, Link, MachineCodec, load_layout
from crane_driver.can.frame import STEP, TIME, Frame, told_time
from crane_interfaces.msg import CylinderPressures
from crane_model import load_machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_nodes.executor import KeptExecutor, Polled
from crane_nodes.node_time import CLOCK_TOPIC, NEWEST_TICK, NodeTime, Pacing

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEEP = QoSProfile(depth=2000)  # messages, that the test has not taken yet
FRAMES = 50_000  # of the bus, for the same reason
AHEAD = 0.05  # s
SERVICES = ("enable", "disable", "emergency_stop", "reset_fault")


def made(message: Any) -> float:
    """When, by the stamp of its header [s]."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


class Valves(NamedTuple):
    """One valve frame on the bus."""

    steady: float  # s: simulated time, or the steady clock
    commands: dict[str, float]
    enabled: bool


class Stage:
    """What runs, what it says, and what passes on the bus."""

    def __init__(
        self,
        folder: Path,
        pose: list[str],
        canopen: Mapping[str, object] = {},
        driver: str = DRIVER,
        namespace: str = "",
        machine: str = DEFAULT_MACHINE,
        operator: bool = False,
        plant: Path | None = None,
        simulation: str = MACHINE,
        real_time: bool = False,
        awaited: bool = True,
    ):
        """The machine's own limits hold in simulated time, those of a patient driver in real time.

        Unless the test is `awaited`, simulated time goes on without it.
        """
        self.simulated = not real_time
        path = mapping_file(folder, machine, canopen, patient=real_time)
        port = self.port = free_port()
        self.layout = load_layout(load_machine(machine), path, machine_file("can.dbc", machine))
        self.codec = MachineCodec(self.layout)
        self._reader = DriverCodec(self.layout)
        self.link = Link(BusSettings(extra={"port": port}), capacity=FRAMES).open()
        given = ["--machine", machine, "--bus-option", f"port={port}"]
        given += ["--operator"] if operator else []
        given += ["--pose", *pose] if pose else []
        given += ["--plant", str(plant)] if plant else []
        given += ["--lock-step"] if self.simulated else []
        self.machine = start(simulation if self.simulated else URGENT_MACHINE, *given)
        options = {"bus.options": f"port={port}", "mapping": str(path), "machine": machine}
        if real_time:
            options["safety"] = patient_safety(folder, machine)
        self._remapping = []
        if namespace:  # of several cranes, each has a time of its own
            clock = f"/{namespace}{CLOCK_TOPIC}"
            self._remapping = ["-r", f"__ns:=/{namespace}", "-r", f"{CLOCK_TOPIC}:={clock}"]
        self.arguments = self.ros(**options)
        self.driver = start(driver, *self.arguments)
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = Node(
            "watcher",
            context=self.context,
            cli_args=["--ros-args", *self._remapping],
            parameter_overrides=[Parameter("use_sim_time", value=self.simulated)],
        )
        self._clock = NodeTime(self.node)
        self._ticks = Polled(self.node, Clock, CLOCK_TOPIC, NEWEST_TICK)
        self._pacing = Pacing(self.node, self._clock, AHEAD)
        if not awaited:
            self._pacing.close()
        self._safety = f"{namespace}/driver: safety".lstrip("/")
        self._executor = KeptExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients = {
            name: self.node.create_client(Trigger, f"driver/{name}") for name in SERVICES
        }
        self.time = 0.0  # s, of the newest cycle on the bus
        self.states: list[JointState] = []
        self.pressures: list[CylinderPressures] = []
        self.diagnostics: dict[str, tuple[bytes, str, dict[str, str]]] = {}
        self.reported = 0.0  # s, when the driver made its last report
        self.encoders: dict[str, float] = {}  # rad, m: as the machine sends them
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

    def ros(self, *arguments: str, **parameters: object) -> list[str]:
        """ROS arguments of a node beside this driver."""
        given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        clock = SIMULATED_TIME if self.simulated else ()
        return ["--ros-args", *self._remapping, *clock, *given, *arguments]

    @property
    def now(self) -> float:
        """A time [s] after every stamp that was given before this call."""
        stamp = self._clock.stamp()
        return stamp.sec + 1e-9 * stamp.nanosec + (AHEAD if self.simulated else 0.0)

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
        self.until_there(lambda: all(one.service_is_ready() for one in self._clients.values()))
        wait_until_heard(self.node, "driver", self.until_there)

    def close(self) -> None:
        self._pacing.close()
        for process in (self.driver, self.machine):
            end(process)
        self.link.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(
        self, condition: Callable[[], object], seconds: float = PATIENCE, still: bool = False
    ) -> None:
        """Work until a condition holds; the seconds bound a test that fails.

        `still`: simulated time stands and leaves the computer to those who are waited for.
        """
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; {self.diagnostics}"
            self.spin(still)

    def until_there(self, condition: Callable[[], object]) -> None:
        """Wait for a process that needs no simulated time."""
        self.until(condition, still=True)

    def end(self, process: subprocess.Popen[str], number: int = signal.SIGTERM) -> int:
        """End a process that may need time to bring the crane to rest; its exit status."""
        process.send_signal(number)
        self.until(lambda: process.poll() is not None)
        return end(process)

    def measured(self, condition: Callable[[JointState], bool] = lambda state: True) -> JointState:
        """A joint state made after this call for which the condition holds."""
        called = self.now
        self.until(lambda: made(self.states[-1]) > called and condition(self.states[-1]))
        return self.states[-1]

    def spin(self, still: bool = False) -> None:
        self._executor.spin_once(timeout_sec=0.01)
        for tick, _ in self._ticks.take():
            self._clock.tell(tick)
        for topic, told in self._topics:
            for message, _ in topic.take():
                told(message)
        for frame in self.link.take():
            if (told := told_time(frame, TIME)) is not None:
                self.time = told * 1e-9
            elif told_time(frame, STEP) is None:
                self._seen(frame, self.time if self.simulated else frame.steady)
        if not still:
            self._pacing.taken()

    def _seen(self, frame: Frame, steady: float) -> None:
        readings = self.codec.decode(frame)
        if readings is None:
            self.frames.append(frame)
            answer = self._reader.decode(frame)
            self.encoders |= answer.positions if answer else {}
            if answer and answer.states:
                self.machine_state = answer.states["valve_unit"]
        elif readings.commands:
            self.valves.append(Valves(steady, readings.commands, bool(readings.enabled)))

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

    @property
    def _refused(self) -> int:
        """Commands that the driver has refused, by its last report."""
        return int(self.safety[1]["commands refused"])

    def report(self) -> tuple[str, dict[str, str]]:
        """What a report on safety says that was made after this call."""
        called = self.now
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
        """Enabled, with a publisher of neutral commands or none."""
        self.disabled()
        self.until(lambda: self.call("enable")[0])  # refused until neutral commands have come
        self.until(lambda: self.valves[-1].enabled)
        return self

    def moving(self, commander: Commander, **commands: float) -> Self:
        """Enabled, and the commands at the valves, from where limits may hold them back.

        In real time a pause of the computer may fault the crane meanwhile, or end the series of
        commands, so that the driver refuses all but a neutral one: it is begun again.
        """

        def heard() -> bool:
            """Else the driver might be enabled before it hears neutral commands."""
            self.disabled()
            return "command neutral first" in self.call("enable")[1]

        def arrived(sent: Valves) -> bool:
            return all(abs(sent.commands[name] - value) < 1e-3 for name, value in commands.items())

        def moves() -> bool:
            commander.send(**commands)
            self.until(heard)
            commander.send(**dict.fromkeys(commands, 0.0))
            self.enabled()
            since, refused = len(self.valves), self._refused
            commander.send(**commands)

            def ended() -> bool:
                stopped = not self.valves[-1].enabled or self._refused > refused
                return any(map(arrived, self.valves[since:])) or stopped

            self.until(ended)
            return any(map(arrived, self.valves[since:]))

        if self.simulated:
            assert moves(), f"not enabled any longer; {self.diagnostics}"
        else:
            self.until(moves)
        return self

    def moved(self, commander: Commander, there: Callable[[], bool], **commands: float) -> Self:
        """The commands at the valves until the crane is there."""
        self.moving(commander, **commands)
        self.until(there)
        return self

    def within(self, condition: Callable[[], bool], seconds: float = 5.0) -> bool:
        """Whether a condition comes to hold within a time of the crane."""
        end = self.now + seconds
        self.until(lambda: condition() or self.now > end)
        return condition()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for one in message.status:
            values = {pair.key: pair.value for pair in one.values}
            self.diagnostics[one.name] = (one.level, one.message, values)
            if one.name == self._safety:
                self.reported = made(message)


@contextmanager
def commander(stage: Stage) -> Iterator[Commander]:
    """A publisher of commands, and none after it."""
    process = Commander(*stage.ros())
    try:
        stage.until_there(lambda: stage.node.count_publishers("valve_command") == 1)
        yield process
    finally:
        process.end()
        stage.until_there(lambda: stage.node.count_publishers("valve_command") == 0)
