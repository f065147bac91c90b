"""`sensor_monitor`: which sensor is faulty, as a managed node."""

import math
from collections.abc import Sequence
from typing import TypeAlias

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_interfaces.msg import CylinderPressures, SensorFindings, ValveCommand
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.parameters import MACHINE, NodeParameter, Text
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.replay import Heed, SensorWatch
from crane_observer.monitor.tolerance import Tolerance
from crane_observer.node.observer_node import (
    COMMANDS,
    JOINT_STATES,
    LATCHED,
    OUTPUTS,
    PRESSURES,
    HeardTopic,
    ObserverNode,
    findings_message,
    picked,
)

Heard: TypeAlias = JointState | CylinderPressures | ValveCommand
HEARD = (JOINT_STATES, PRESSURES, COMMANDS, OUTPUTS)
MONITOR_VISIT = 0.01  # s between two visits to the queues
MONITOR_SILENCE = 0.5  # s without a sample that could be compared

MODEL = Text(
    "model",
    "",
    "Model file, with hydraulics if sensors are to be compared; empty: model.yaml of the machine. "
    "At configure",
)
TOLERANCE = Text(
    "tolerance",
    "",
    "File that check_sensors --learn wrote; empty: a wide tolerance is assumed. At configure",
)
PARAMETERS: tuple[NodeParameter, ...] = (AUTOSTART, MACHINE, MODEL, TOLERANCE)


class SensorMonitorNode(ObserverNode):
    """Compares encoders, pressures and commands, and tells which of them is faulty."""

    def __init__(self) -> None:
        super().__init__("sensor_monitor", PARAMETERS, HEARD, MONITOR_VISIT, "sensors")
        self._watch: SensorWatch | None = None
        self._compared = -math.inf  # s
        self._findings = self.create_lifecycle_publisher(SensorFindings, "sensor_findings", LATCHED)
        self.create_service(Trigger, "~/forget", self._forget)

    def read(self) -> None:
        """Model and tolerance; without hydraulics, each sensor is watched by itself."""
        self._model = load_model(machine_file("model.yaml", MACHINE.read(self), MODEL.read(self)))
        file = TOLERANCE.read(self)
        self._tolerance = load(file, Tolerance) if file else None
        SensorWatch(self._model, self._tolerance)  # refuses what it cannot use

    def begin(self) -> None:
        """Nothing has been found yet, which is told to who heard of a monitor before."""
        self._watch = SensorWatch(self._model, self._tolerance)
        self._compared = -math.inf
        self._publish()

    def end(self) -> None:
        self._watch = None

    def take(self, stamp: int, topic: HeardTopic, message: Heard) -> None:
        for finding in self._found(self.seconds(stamp), message):
            self.get_logger().error(str(finding))
            self._publish()

    def report(self, status: DiagnosticStatus) -> None:
        """Report the findings, or the distance to the nearest one."""
        assert self._watch is not None
        if findings := self._watch.monitor.findings:
            status.level = DiagnosticStatus.ERROR
            status.message = "; ".join(f"{finding.sensor}: {finding.kind}" for finding in findings)
            status.values = [KeyValue(key=found.sensor, value=str(found)) for found in findings]
        elif self.clock.now() - self._compared > MONITOR_SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, Heed.WAITING.value
        else:
            status.message = self._watch.condition.value
            largest = float(self._watch.monitor.taken.max(initial=0.0))
            status.values = [
                KeyValue(key="tolerance taken [%]", value=f"{100.0 * largest:.0f}"),
                KeyValue(key="samples not used [-]", value=str(self._watch.refused)),
                KeyValue(key="last of them", value=self._watch.last_refusal),
            ]

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

    def _found(self, seconds: float, message: Heard) -> list[SensorFinding]:
        assert self._watch is not None
        joints, watched = self._model.joints, self._watch
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
                    self._compared = self.clock.now()
                return found

    def _publish(self) -> None:
        assert self._watch is not None
        self._findings.publish(findings_message(self._watch.monitor.findings, self.zero or 0))


ABOUT = """Compares encoders in joint_states, cylinder_pressures and valve_output (without a driver:
valve_command) by a model with hydraulics; without hydraulics, checks each sensor on its own.
Publishes sensor_findings: the faulty sensor, with kind and size of the fault, onset and remedy."""


def main(argv: Sequence[str] | None = None) -> int:
    """Tell which sensor is faulty."""
    return run_managed("sensor_monitor", SensorMonitorNode, ABOUT, PARAMETERS, argv)
