"""`position_estimator`: positions and the load at the tip as a managed node."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, DriverState, PositionEstimate, ValveCommand
from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.parameters import MACHINE, NodeParameter, Number, Numbers, Text
from crane_observer.node.observer_node import (
    COMMANDS,
    DEEP,
    JOINT_STATES,
    OUTPUTS,
    PRESSURES,
    HeardTopic,
    ObserverNode,
    estimate_message,
    picked,
    states_message,
)
from crane_observer.position.estimator import (
    START_DEVIATION,
    EstimatorCondition,
    PositionEstimator,
    WindowEstimate,
)
from crane_observer.position.filter import refuse_unserved

POSITION_VISIT = 0.01  # s between two visits to the queues
POSITION_SILENCE = 0.5  # s without pressures, after which they are reported as lost
POSITION_WAIT = 20_000_000  # ns, that a topic is waited for: what is told late moves no joint
UNNOTICED = 1.0  # s, for which an encoder may have been wrong before the driver says so
ALL_LATCHED = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
DRIVER_STATE = HeardTopic("driver/state", DriverState, ALL_LATCHED)
HEARD = (DRIVER_STATE, JOINT_STATES, PRESSURES, COMMANDS, OUTPUTS)
Heard: TypeAlias = JointState | CylinderPressures | ValveCommand | DriverState
LETTING_THROUGH = (DriverState.STATE_ENABLED, DriverState.STATE_DEGRADED)
WRONG_POSITION = (
    DriverState.FAULT_FROZEN,
    DriverState.FAULT_JUMPED,
    DriverState.FAULT_FAULTY_ENCODER,
)

MODEL = Text(
    "model", "", "Model file, best with hydraulics; empty: model.yaml of the machine. At configure"
)
WITHOUT = Text(
    "without", "", "Joints whose encoders are not to be used, separated by spaces. At configure"
)
POSITION = Numbers(
    "start", (), "rad or m", -100.0, 100.0,
    "Start positions of the joints, in the order of the model; empty: from the encoders, and "
    "unknown for joints without. At configure",
)  # fmt: skip
DEVIATION = Number(
    "start_deviation", START_DEVIATION, "rad or m", 1e-5, 1.0,
    "Standard deviation of start. At configure",
)  # fmt: skip
PARAMETERS: tuple[NodeParameter, ...] = (AUTOSTART, MACHINE, MODEL, WITHOUT, POSITION, DEVIATION)


@dataclass(frozen=True)
class EstimatorStart:
    """Start of a position estimator."""

    model: Model
    hidden: Flags  # (j,) joints whose encoders are not to be used
    position: Array | None  # (j,) rad, m; None: by the encoders
    deviation: float  # rad, m


class PositionHearing:
    """Messages to a position estimator, made with the first that shows the pose."""

    def __init__(self, start: EstimatorStart):
        self.estimator: PositionEstimator | None = None
        self._start = start
        self._commanded = np.zeros(len(start.hidden))
        self._lost: set[str] = set()  # joints whose encoders the driver does not believe
        self._closed = False  # the driver says that commands do not reach the valves
        self._outputs_heard = False  # the driver tells what it sends to the valves
        self._zero = 0

    def take(self, stamp: int, message: Heard, sent: bool) -> WindowEstimate | None:
        """Add a message; `sent`: by the driver to the valves, which precedes requested commands."""
        joints = self._start.model.joints
        match message:
            case JointState():
                encoders = picked(joints, message.name, message.position)
                encoders[self._start.hidden | np.isin(joints, list(self._lost))] = np.nan
                if estimator := self._started(stamp, encoders):
                    estimator.add_encoders(self._seconds(stamp), encoders)
            case ValveCommand() if sent or not self._outputs_heard:
                self._outputs_heard = sent
                # a joint that is not named stays at neutral
                self._commanded = picked(joints, message.name, message.command)
                self._commanded[~np.isin(joints, message.name)] = 0.0
                self._command(stamp)
            case DriverState():
                closed = message.state not in LETTING_THROUGH
                self._judge(stamp, message)
                if closed is not self._closed and not self._outputs_heard:
                    self._closed = closed
                    self._command(stamp)
            case CylinderPressures():
                if estimator := self._started(stamp, None):
                    return estimator.add_pressures(
                        self._seconds(stamp),
                        picked(joints, message.name, message.chamber_a),
                        picked(joints, message.name, message.chamber_b),
                        message.supply,
                    )
        return None

    def _seconds(self, stamp: int) -> float:
        return (stamp - self._zero) / NANOSECONDS

    def _judge(self, stamp: int, message: DriverState) -> None:
        """Which encoders the driver believes."""
        lost = {message.substituted}
        if message.fault in WRONG_POSITION:
            lost.add(message.source)
        if self.estimator is not None:
            for j, joint in enumerate(self._start.model.joints):
                if joint not in lost:
                    self.estimator.believe(j)
                elif joint not in self._lost:
                    self.estimator.distrust(j, self._seconds(stamp) - UNNOTICED)
        self._lost = lost

    def _command(self, stamp: int) -> None:
        """Apply the present commands of the valves from now on."""
        if self.estimator is not None:
            through = self._outputs_heard or not self._closed
            reaching = self._commanded if through else np.zeros_like(self._commanded)
            self.estimator.add_command(self._seconds(stamp), reaching)

    def _started(self, stamp: int, encoders: Array | None) -> PositionEstimator | None:
        """The estimator: made once, with the first encoders, or where it is said without them."""
        start = self._start
        if self.estimator is not None:
            return self.estimator
        if start.position is not None:
            position = start.position
        elif encoders is not None:
            position = encoders
        elif start.hidden.all():
            position = np.full(len(start.hidden), np.nan)
        else:
            return None
        self._zero = stamp
        self.estimator = PositionEstimator(start.model, position, start.deviation)
        return self.estimator


class PositionEstimatorNode(ObserverNode):
    """Listens to pressures, commands and encoders, and tells where the joints are."""

    def __init__(self) -> None:
        super().__init__(
            "position_estimator", PARAMETERS, HEARD, POSITION_VISIT, "positions", POSITION_WAIT
        )
        self._hearing: PositionHearing | None = None
        self._pressed = 0.0
        self._told: WindowEstimate | None = None
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
        position = np.array(start) if start else None
        self._start = EstimatorStart(model, hidden, position, DEVIATION.read(self))

    def begin(self) -> None:
        self._hearing, self._told = PositionHearing(self._start), None
        self._pressed = self.clock.now()

    def end(self) -> None:
        self._hearing = None

    def counts(self, topic: HeardTopic) -> bool:
        if topic is PRESSURES:
            self._pressed = self.clock.now()
        return super().counts(topic)

    def take(self, stamp: int, topic: HeardTopic, message: Heard) -> None:
        assert self._hearing is not None
        told = self._hearing.take(stamp, message, sent=topic is OUTPUTS)
        if told is None:
            return
        if self._told is None or told.condition is not self._told.condition:
            self.get_logger().info(told.condition.value)
        self._told = told
        joints = self._start.model.joints
        self._states.publish(states_message(joints, told, stamp))
        self._estimates.publish(estimate_message(joints, told, stamp))

    def report(self, status: DiagnosticStatus) -> None:
        told, estimator = self._told, self._hearing.estimator if self._hearing else None
        if told is None or estimator is None or self.clock.now() - self._pressed > POSITION_SILENCE:
            status.level, status.message = DiagnosticStatus.WARN, EstimatorCondition.WAITING.value
            return
        joints = zip(self._start.model.joints, told.observable, strict=True)
        blind = [joint for joint, seen in joints if not seen]
        status.message = told.condition.value
        if blind:
            status.message += f"; not observable: {', '.join(blind)}"
        if blind or told.condition is not EstimatorCondition.GOOD:
            status.level = DiagnosticStatus.WARN
        estimate = told.estimate
        status.values = [
            KeyValue(key="load [kg]", value=f"{estimate.load:.1f}"),
            KeyValue(key="load, standard deviation [kg]", value=f"{estimate.deviation[-1]:.1f}"),
            KeyValue(key="late [-]", value=str(estimator.late)),
            KeyValue(key="invalid [-]", value=str(estimator.invalid)),
        ]


ABOUT = """Estimates positions, velocities and the payload from cylinder_pressures, valve_output
(without a driver: valve_command) and the remaining encoders in joint_states, by a model with
hydraulics; if a valve is not identified, by the weight of the crane. Publishes
joint_states_estimated and position_estimate."""


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions without encoders."""
    return run_managed("position_estimator", PositionEstimatorNode, ABOUT, PARAMETERS, argv)
