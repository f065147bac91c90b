"""`payload_estimator`: what hangs at the tip, as a managed node."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import (
    CylinderPressures,
    PositionEstimate,
    SensorFindings,
    TipLoad,
    ValveCommand,
)
from crane_model import cli
from crane_model.array import Array, Flags
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.parameters import MACHINE, NodeParameter, Text
from crane_observer.node.observer_node import (
    COMMANDS,
    JOINT_STATES,
    LATCHED,
    OUTPUTS,
    PRESSURES,
    HeardTopic,
    ObserverNode,
    load_message,
    picked,
)
from crane_observer.payload.estimator import (
    HEADINGS,
    Lift,
    LiftLog,
    PayloadCondition,
    PayloadEstimate,
    PayloadEstimator,
)

Heard: TypeAlias = JointState | PositionEstimate | CylinderPressures | ValveCommand
ESTIMATES = HeardTopic("position_estimate", PositionEstimate)
HEARD = (JOINT_STATES, ESTIMATES, PRESSURES, COMMANDS, OUTPUTS)
PAYLOAD_VISIT = 0.02  # s between two visits to the queues
PAYLOAD_WAIT = 500_000_000  # ns, with a topic that lags: nobody moves by the load
PAYLOAD_SILENCE = 1.0  # s without an estimate

MODEL = Text("model", "", "Identified model file; empty: model.yaml of the machine. At configure")
LOG = Text("log", "", "New file (CSV) to which lifts are written; empty: none. At configure")
PARAMETERS: tuple[NodeParameter, ...] = (AUTOSTART, MACHINE, MODEL, LOG)


def distrusted(joints: Sequence[str], found: SensorFindings, zero: int) -> tuple[Array, Flags]:
    """When each encoder became faulty, in seconds since `zero` [ns], infinite for a sound one; and
    whether a pressure transducer of each joint is faulty: (j,) each.
    """
    encoders, pressures = np.full(len(joints), np.inf), np.zeros(len(joints), dtype=bool)
    for k, joint in enumerate(found.joint):
        if joint not in joints:
            continue
        if found.dangerous[k]:
            encoders[joints.index(joint)] = found.onset[k] - zero / NANOSECONDS
        elif "pressure" in found.sensor[k]:
            pressures[joints.index(joint)] = True
    return encoders, pressures


class PayloadEstimatorNode(ObserverNode):
    """Listens to pressures and positions, and tells what hangs at the tip."""

    def __init__(self) -> None:
        super().__init__(
            "payload_estimator", PARAMETERS, HEARD, PAYLOAD_VISIT, "load", PAYLOAD_WAIT
        )
        self._lifts = LiftLog()
        self._payload: PayloadEstimate | None = None
        self._estimated = 0.0
        self._estimator: PayloadEstimator | None = None
        self._findings, self._heeded = SensorFindings(), True
        self._loads = self.create_lifecycle_publisher(TipLoad, "tip_load", LATCHED)
        self.create_subscription(SensorFindings, "sensor_findings", self._found, LATCHED)
        self.create_service(Trigger, "~/tare", self._tare)

    def read(self) -> None:
        """The model, and begin the log; refused where the model was never identified."""
        self._model = load_model(machine_file("model.yaml", MACHINE.read(self), MODEL.read(self)))
        PayloadEstimator(self._model)  # refuses what it cannot use
        self._log = Path(LOG.read(self)) if LOG.read(self) else None
        if self._log:
            cli.check_out(self._log)
            self._log.parent.mkdir(parents=True, exist_ok=True)
            self._write(HEADINGS)

    def begin(self) -> None:
        """Nothing is known of the load yet."""
        self._lifts, self._payload = LiftLog(), None
        self._estimator = PayloadEstimator(self._model)
        self._heeded = False

    def end(self) -> None:
        """The lift that hangs there ends."""
        self._ended(self._lifts.end())
        self._estimator = None

    def take(self, stamp: int, topic: HeardTopic, message: Heard) -> None:
        assert self._estimator is not None
        joints, estimator, seconds = self._model.joints, self._estimator, self.seconds(stamp)
        self._heed(estimator)
        match message:
            case ValveCommand():
                estimator.add_command(seconds, picked(joints, message.name, message.command))
            case JointState():
                estimator.add_encoders(seconds, picked(joints, message.name, message.position))
            case PositionEstimate():
                told = (message.position, message.velocity, message.std_dev)
                columns = (picked(joints, message.name, values) for values in told)
                estimator.add_estimate(seconds, *columns)
            case _:
                a = picked(joints, message.name, message.chamber_a)
                b = picked(joints, message.name, message.chamber_b)
                for payload in estimator.add_pressures(seconds, a, b, message.supply):
                    self._tell(payload)

    def report(self, status: DiagnosticStatus) -> None:
        if self._payload is None or self.clock.now() - self._estimated > PAYLOAD_SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, PayloadCondition.WAITING.value
            return
        assert self._estimator is not None
        load = self._payload.load
        status.message = self._payload.condition.value
        status.values = [
            KeyValue(key="load [kg]", value=f"{load.mass:.1f}"),
            KeyValue(key="load, standard deviation [kg]", value=f"{load.deviation:.1f}"),
            KeyValue(key="late [-]", value=str(self._estimator.late)),
            KeyValue(key="invalid [-]", value=str(self._estimator.invalid)),
        ]

    def _found(self, message: SensorFindings) -> None:
        self._findings, self._heeded = message, False

    def _heed(self, estimator: PayloadEstimator) -> None:
        """Leave out the sensors that were found faulty."""
        if not self._heeded:
            self._heeded = True
            estimator.distrust(*distrusted(self._model.joints, self._findings, self.zero or 0))

    def _tare(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        answer.success = self._estimator is not None and self._payload is not None
        if self._estimator is None or self._payload is None:
            answer.message = "there is no estimate yet: wait for tip_load"
            return answer
        self._estimator.tare()
        load = self._payload.load
        answer.message = f"{load.mass:.1f} kg ± {load.deviation:.1f} kg count as nothing now"
        return answer

    def _tell(self, payload: PayloadEstimate) -> None:
        assert self.zero is not None
        if self._payload is None or payload.condition is not self._payload.condition:
            self.get_logger().info(payload.condition.value)
        self._payload, self._estimated = payload, self.clock.now()
        self._loads.publish(load_message(payload, self.zero))
        self._ended(self._lifts.add(payload))

    def _ended(self, lift: Lift | None) -> None:
        if lift is None or self.zero is None:
            return
        load = lift.load
        self.get_logger().info(f"lift: {load.mass:.1f} kg ± {load.deviation:.1f} kg")
        if self._log:
            self._write(lift.row(self.zero / NANOSECONDS))

    def _write(self, row: Sequence[str]) -> None:
        assert self._log is not None
        with self._log.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow(row)


ABOUT = """Estimates the payload from cylinder_pressures and joint_states, by an identified model;
for joints without encoder from position_estimate. Ignores faulty sensors of sensor_findings. With
hydraulics, doubts an encoder that contradicts the flow of valve_output (without a driver:
valve_command). Publishes tip_load; ~/tare tares."""


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate the load at the tip."""
    return run_managed("payload_estimator", PayloadEstimatorNode, ABOUT, PARAMETERS, argv)
