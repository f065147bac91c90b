"""`position_sensor`: positions and the load at the tip as a managed node."""

from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState

from crane_interfaces.msg import CylinderPressures, PositionEstimate
from crane_model.errors import ConfigurationError
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.parameters import NodeParameter, Number, Numbers, Text
from crane_observer.node.observer_node import ObserverNode
from crane_observer.node.position_topics import HEARD, Beginning, Heard, PositionHearing
from crane_observer.node.topics import (
    DEEP,
    estimate_message,
    states_message,
)
from crane_observer.position.observability import HEAVIEST
from crane_observer.position.sensor import START, SensorCondition, Told
from crane_observer.position.serving import refuse_unserved

VISIT = 0.01  # s between two visits to the queues
SILENCE = 0.5  # s without pressures, after which they are reported as lost

MODEL = Text(
    "model", "", "Model file, best with hydraulics; empty: model.yaml of the machine. At configure"
)
WITHOUT = Text(
    "without", "", "Joints whose encoders are not to be used, separated by spaces. At configure"
)
POSITION = Numbers(
    "start",
    (),
    "rad or m",
    -100.0,
    100.0,
    "Where the joints of the model are, in its order; empty: by the encoders, and unknown of "
    "joints without. At configure",
)
DEVIATION = Number(
    "start_deviation", START, "rad or m", 1e-5, 1.0, "Standard deviation of start. At configure"
)
HEAVIEST_LOAD = Number(
    "heaviest_load", HEAVIEST, "kg", 1.0, 1e5,
    "What may hang at the tip; where forces ask for more, nothing is to be believed. At configure",
)  # fmt: skip
PARAMETERS: tuple[NodeParameter, ...] = (
    AUTOSTART, MACHINE, MODEL, WITHOUT, POSITION, DEVIATION, HEAVIEST_LOAD,
)  # fmt: skip


class PositionSensorNode(ObserverNode):
    """Listens to pressures, commands and encoders, and tells where the joints are."""

    def __init__(self) -> None:
        super().__init__("position_sensor", PARAMETERS, HEARD, VISIT, "positions")
        self._hearing: PositionHearing | None = None
        self._pressed = 0.0
        self._told: Told | None = None
        self._states = self.create_lifecycle_publisher(JointState, "joint_states_estimated", DEEP)
        self._estimates = self.create_lifecycle_publisher(
            PositionEstimate, "position_estimate", DEEP
        )

    def read(self) -> None:
        """Model and start; refused where the model cannot tell what is asked."""
        model = load_model(machine_file("model.yaml", MACHINE.read(self), MODEL.read(self)))
        without, start = WITHOUT.read(self).split(), POSITION.read(self)
        if unknown := [joint for joint in without if joint not in model.joints]:
            raise ConfigurationError(
                f"parameter 'without': no joint {', '.join(unknown)}; the model has "
                f"{', '.join(model.joints)}"
            )
        if start and len(start) != len(model.joints):
            raise ConfigurationError(
                f"parameter 'start': must have {len(model.joints)} numbers, for "
                f"{', '.join(model.joints)}; got {len(start)}"
            )
        hidden = np.isin(model.joints, without)
        for warning in refuse_unserved(model, hidden):
            self.get_logger().warning(warning)
        self._begin = Beginning(
            model,
            hidden,
            np.array(start) if start else None,
            DEVIATION.read(self),
            HEAVIEST_LOAD.read(self),
        )

    def begin(self) -> None:
        """From where the crane is said to be."""
        self._hearing, self._told = PositionHearing(self._begin), None
        self._pressed = self.clock.now()

    def end(self) -> None:
        """Where the crane is has to be found anew."""
        self._hearing = None

    def hear(self, topic: int, message: Heard) -> None:
        """In the order of stamps, whatever came first."""
        assert self._hearing is not None
        self._hearing.add(topic, message)
        if isinstance(message, CylinderPressures):
            self._pressed = self.clock.now()

    def tell(self) -> None:
        """Where the joints are."""
        assert self._hearing is not None
        for stamp, told in self._hearing.take():
            self._tell(stamp, told)

    def report(self, status: DiagnosticStatus) -> None:
        """Condition, and what is not observable."""
        told, sensor = self._told, self._hearing.sensor if self._hearing else None
        if told is None or sensor is None or self.clock.now() - self._pressed > SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, SensorCondition.WAITING.value
            return
        joints = zip(self._begin.model.joints, told.observable, strict=True)
        blind = [joint for joint, seen in joints if not seen]
        status.message = told.condition.value
        if blind:
            status.message += f"; not observable: {', '.join(blind)}"
        if blind or told.condition is not SensorCondition.GOOD:
            status.level = DiagnosticStatus.WARN
        estimate = told.estimate
        status.values = [
            KeyValue(key="load [kg]", value=f"{estimate.load:.1f}"),
            KeyValue(key="load, standard deviation [kg]", value=f"{estimate.deviation[-1]:.1f}"),
            KeyValue(key="late [-]", value=str(sensor.late)),
            KeyValue(key="invalid [-]", value=str(sensor.invalid)),
        ]

    def _tell(self, stamp: int, told: Told) -> None:
        if self._told is None or told.condition is not self._told.condition:
            self.get_logger().info(told.condition.value)
        self._told = told
        joints = self._begin.model.joints
        self._states.publish(states_message(joints, told, stamp))
        self._estimates.publish(estimate_message(joints, told, stamp))


ABOUT = """Estimates positions, velocities and the load at the tip from cylinder_pressures,
valve_output (without a driver that tells it valve_command, while driver/state lets it through) and
the encoders in joint_states that are left, by a model with hydraulics; where a
valve is not identified, by the weight of the crane. Publishes
joint_states_estimated and position_estimate."""


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions without encoders."""
    return run_managed("position_sensor", PositionSensorNode, ABOUT, PARAMETERS, argv)
