"""`scale`: what hangs at the tip, as a managed node."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, PositionEstimate, TipLoad
from crane_model import cli
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.node_time import nanoseconds
from crane_nodes.parameters import NodeParameter, Text
from crane_observer.node.observer_node import (
    DEEP,
    JOINT_STATES,
    LATCHED,
    PRESSURES,
    InOrder,
    ObserverNode,
    load_message,
    picked,
)
from crane_observer.scale.scale import (
    HEADINGS,
    Lift,
    LiftLog,
    Scale,
    ScaleCondition,
    Weighing,
    row_of,
)

Heard: TypeAlias = JointState | PositionEstimate | CylinderPressures
HEARD = (
    (JOINT_STATES, JointState, DEEP),
    ("position_estimate", PositionEstimate, DEEP),
    (PRESSURES, CylinderPressures, DEEP),
)
VISIT = 0.02  # s between two visits to the queues
PATIENCE = 500_000_000  # ns, with a topic that lags: nobody moves by the load
SILENCE = 1.0  # s without a weighing

MODEL = Text("model", "", "Identified model file; empty: model.yaml of the machine. At configure")
LOG = Text("log", "", "New file (CSV) to which lifts are written; empty: none. At configure")
PARAMETERS: tuple[NodeParameter, ...] = (AUTOSTART, MACHINE, MODEL, LOG)


class ScaleNode(ObserverNode):
    """Listens to pressures and positions, and tells what hangs at the tip."""

    def __init__(self) -> None:
        super().__init__("scale", PARAMETERS, HEARD, VISIT, "load")
        self._came: InOrder[Heard] = InOrder(PATIENCE)
        self._lifts = LiftLog()
        self._zero: int | None = None
        self._weighing: Weighing | None = None
        self._weighed = 0.0
        self._scale: Scale | None = None
        self._loads = self.create_lifecycle_publisher(TipLoad, "tip_load", LATCHED)
        self.create_service(Trigger, "~/tare", self._tare)

    def read(self) -> None:
        """The model, and begin the log; refused where the model was never identified."""
        self._model = load_model(machine_file("model.yaml", MACHINE.read(self), MODEL.read(self)))
        Scale(self._model)  # refuses what it cannot use
        self._log = Path(LOG.read(self)) if LOG.read(self) else None
        if self._log:
            cli.check_out(self._log)
            self._log.parent.mkdir(parents=True, exist_ok=True)
            self._write(HEADINGS)

    def begin(self) -> None:
        """Nothing is known of the load yet."""
        self._came, self._lifts = InOrder(PATIENCE), LiftLog()
        self._scale, self._zero, self._weighing = Scale(self._model), None, None

    def end(self) -> None:
        """The lift that hangs there ends."""
        self._ended(self._lifts.end())
        self._scale = None

    def hear(self, topic: int, message: Heard) -> None:
        """In the order of stamps, whatever came first."""
        self._came.add(nanoseconds(message.header.stamp), topic, message)

    def tell(self) -> None:
        """What follows for the load."""
        for stamp, _, message in self._came.take():
            for weighing in self._take(stamp, message):
                self._tell(weighing)

    def report(self, status: DiagnosticStatus) -> None:
        """Load and condition."""
        if self._weighing is None or self.clock.now() - self._weighed > SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, ScaleCondition.WAITING.value
            return
        assert self._scale is not None
        load = self._weighing.load
        status.message = self._weighing.condition.value
        status.values = [
            KeyValue(key="load [kg]", value=f"{load.mass:.1f}"),
            KeyValue(key="load, standard deviation [kg]", value=f"{load.deviation:.1f}"),
            KeyValue(key="late [-]", value=str(self._scale.late)),
            KeyValue(key="invalid [-]", value=str(self._scale.invalid)),
        ]

    def _tare(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        answer.success = self._scale is not None and self._weighing is not None
        if self._scale is None or self._weighing is None:
            answer.message = "nothing was weighed yet: wait for tip_load"
            return answer
        self._scale.tare()
        load = self._weighing.load
        answer.message = f"{load.mass:.1f} kg ± {load.deviation:.1f} kg count as nothing now"
        return answer

    def _take(self, stamp: int, message: Heard) -> list[Weighing]:
        assert self._scale is not None
        joints, scale = self._model.joints, self._scale
        if self._zero is None:
            self._zero = stamp
        seconds = (stamp - self._zero) / NANOSECONDS
        match message:
            case JointState():
                scale.add_encoders(seconds, picked(joints, message.name, message.position))
                return []
            case PositionEstimate():
                told = (message.position, message.velocity, message.std_dev)
                scale.add_estimate(seconds, *(picked(joints, message.name, one) for one in told))
                return []
            case _:
                return scale.add_pressures(
                    seconds,
                    picked(joints, message.name, message.chamber_a),
                    picked(joints, message.name, message.chamber_b),
                )

    def _tell(self, weighing: Weighing) -> None:
        assert self._zero is not None
        if self._weighing is None or weighing.condition is not self._weighing.condition:
            self.get_logger().info(weighing.condition.value)
        self._weighing, self._weighed = weighing, self.clock.now()
        self._loads.publish(load_message(weighing, self._zero))
        self._ended(self._lifts.add(weighing))

    def _ended(self, lift: Lift | None) -> None:
        if lift is None or self._zero is None:
            return
        load = lift.load
        self.get_logger().info(f"lift: {load.mass:.1f} kg ± {load.deviation:.1f} kg")
        if self._log:
            self._write(row_of(lift, self._zero / NANOSECONDS))

    def _write(self, row: Sequence[str]) -> None:
        assert self._log is not None
        with self._log.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow(row)


ABOUT = """Weighs what hangs at the tip from cylinder_pressures and joint_states, of a joint without
encoder from position_estimate, by an identified model. Publishes tip_load; ~/tare tares."""


def main(argv: Sequence[str] | None = None) -> int:
    """Weigh what hangs at the tip."""
    return run_managed("scale", ScaleNode, ABOUT, PARAMETERS, argv)
