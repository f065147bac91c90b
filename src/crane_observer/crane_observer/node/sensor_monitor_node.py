"""`sensor_monitor`: which sensor is lying, as a managed node."""

import time
from collections.abc import Sequence
from typing import TypeAlias

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, SensorFindings, ValveCommand
from crane_model.configuration import load
from crane_model.errors import CraneError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.names import full_name
from crane_nodes.parameters import NodeParameter, Text, declare, hold
from crane_nodes.polled import Polled
from crane_nodes.ready import say_ready
from crane_nodes.stamps import nanoseconds
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.tolerance import Tolerance
from crane_observer.monitor.watching import Heed, SensorWatch
from crane_observer.node.in_order import InOrder
from crane_observer.node.topics import (
    COMMANDS,
    DEEP,
    JOINT_STATES,
    LATCHED,
    OUTPUTS,
    PRESSURES,
    findings_message,
    picked,
    report_message,
)

Heard: TypeAlias = JointState | CylinderPressures | ValveCommand
HEARD = (
    (JOINT_STATES, JointState),
    (PRESSURES, CylinderPressures),
    (COMMANDS, ValveCommand),
    (OUTPUTS, ValveCommand),
)
ASKED, SENT = 2, 3  # places of what the driver was asked for, and of what it sent to the valves
PUBLISH = 1.0  # s, of diagnostics
VISIT = 0.01  # s between two visits to the queues
SILENCE = 0.5  # s without a sample that could be compared

MODEL = Text(
    "model", "", "Model file with hydraulics; empty: model.yaml of the machine. At configure"
)
TOLERANCE = Text(
    "tolerance",
    "",
    "File that check_sensors --learn wrote; empty: a wide tolerance is assumed. At configure",
)
PARAMETERS: tuple[NodeParameter, ...] = (AUTOSTART, MACHINE, MODEL, TOLERANCE)


class SensorMonitorNode(LifecycleNode):
    """Compares encoders, pressures and commands, and tells which of them lies."""

    def __init__(self) -> None:
        super().__init__("sensor_monitor")
        declare(self, PARAMETERS, read_only=(AUTOSTART, MACHINE))
        self._model: Model | None = None
        self._tolerance: Tolerance | None = None
        self._watch: SensorWatch | None = None
        hold(self, PARAMETERS, lambda: "configured" if self._model else "unconfigured")
        self._queues: list[tuple[int, Polled]] = []
        self._came: InOrder[Heard] = InOrder()
        self._outputs_heard = False  # the driver tells what it sends to the valves
        self._zero: int | None = None
        self._heard = 0.0
        self._findings = self.create_lifecycle_publisher(SensorFindings, "sensor_findings", LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_service(Trigger, "~/forget", self._forget)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(VISIT, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._report, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read model and tolerance; refused where the model has no hydraulics."""
        try:
            model = load_model(machine_file("model.yaml", MACHINE.read(self), MODEL.read(self)))
            file = TOLERANCE.read(self)
            tolerance = load(file, Tolerance) if file else None
            SensorWatch(model, tolerance)  # refuses what it cannot use
            self._model, self._tolerance = model, tolerance
        except CraneError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen; nothing has been found yet, which is told to who heard of a monitor before."""
        self._queues = [
            (order, Polled(self, msgtype, topic, DEEP))
            for order, (topic, msgtype) in enumerate(HEARD)
        ]
        self._came, self._outputs_heard = InOrder(), False
        assert self._model is not None
        self._watch, self._zero = SensorWatch(self._model, self._tolerance), None
        activated = super().on_activate(state)
        self._publish()
        say_ready(self)
        return activated

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more; what was found is forgotten."""
        for _, queue in self._queues:
            queue.close()
        self._queues, self._watch = [], None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the model."""
        self._model = self._tolerance = None
        return super().on_cleanup(state)

    def _forget(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        answer.success = self._watch is not None
        if self._watch is None:
            answer.message = "not active: nothing is watched"
            return answer
        count = len(self._watch.monitor.findings)
        self._watch.monitor.forget()
        answer.message = f"{count} findings forgotten; all sensors are watched again"
        self._publish()
        return answer

    def _visit(self) -> None:
        for topic, queue in self._queues:
            for message, _ in queue.take():
                self._outputs_heard = self._outputs_heard or topic == SENT
                if self._outputs_heard and topic == ASKED:
                    continue  # the driver tells what it made of it
                self._came.add(nanoseconds(message.header.stamp), topic, message)
        for stamp, _, message in self._came.take():
            for finding in self._take(stamp, message):
                self.get_logger().error(str(finding))
                self._publish()

    def _take(self, stamp: int, message: Heard) -> list[SensorFinding]:
        assert self._model is not None and self._watch is not None
        joints, watched = self._model.joints, self._watch
        if self._zero is None:
            self._zero = stamp
        seconds = (stamp - self._zero) / NANOSECONDS
        match message:
            case JointState():
                return watched.add_encoders(seconds, picked(joints, message.name, message.position))
            case ValveCommand():
                watched.add_command(seconds, picked(joints, message.name, message.command))
                return []
            case _:
                refused = watched.refused
                found = watched.add_pressures(
                    seconds,
                    picked(joints, message.name, message.chamber_a),
                    picked(joints, message.name, message.chamber_b),
                    message.supply,
                )
                if watched.refused == refused:
                    self._heard = time.monotonic()
                return found

    def _publish(self) -> None:
        assert self._watch is not None
        self._findings.publish(findings_message(self._watch.monitor.findings, self._zero or 0))

    def _report(self) -> None:
        found = DiagnosticStatus(name=f"{full_name(self)}: sensors", level=DiagnosticStatus.OK)
        if self._watch is None:
            found.message = "not active"
        elif findings := self._watch.monitor.findings:
            found.level = DiagnosticStatus.ERROR
            found.message = "; ".join(f"{one.sensor}: {one.kind}" for one in findings)
            found.values = [KeyValue(key=one.sensor, value=str(one)) for one in findings]
        elif time.monotonic() - self._heard > SILENCE:
            found.level, found.message = DiagnosticStatus.WARN, Heed.WAITING.value
        else:
            found.message = self._watch.condition.value
            largest = float(self._watch.monitor.taken.max())
            found.values = [
                KeyValue(key="tolerance taken [%]", value=f"{100.0 * largest:.0f}"),
                KeyValue(key="samples not used [-]", value=str(self._watch.refused)),
                KeyValue(key="last of them", value=self._watch.last_refusal),
            ]
        self._diagnostics.publish(report_message(found, self.get_clock().now().to_msg()))


ABOUT = """Compares encoders in joint_states, cylinder_pressures and valve_output (without a driver
that tells it valve_command) by a model with hydraulics. Publishes sensor_findings: which sensor
lies, how, how much, since when, what to do."""


def main(argv: Sequence[str] | None = None) -> int:
    """Tell which sensor is lying."""
    return run_managed("sensor_monitor", SensorMonitorNode, ABOUT, PARAMETERS, argv)
