"""`position_sensor`: positions and the load at the tip as a managed node."""

import time
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, DriverState, PositionEstimate, ValveCommand
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.names import full_name
from crane_nodes.parameters import NodeParameter, Number, Numbers, Text, declare, hold
from crane_nodes.polled import Polled
from crane_nodes.ready import say_ready
from crane_nodes.stamps import nanoseconds
from crane_observer.node.topics import (
    COMMANDS,
    DEEP,
    JOINT_STATES,
    OUTPUTS,
    PRESSURES,
    estimate_message,
    picked,
    report_message,
    states_message,
)
from crane_observer.position.observability import HEAVIEST
from crane_observer.position.sensor import START, PositionSensor, SensorCondition, Told

DRIVER_STATE = "driver/state"
ALL_LATCHED = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
PUBLISH = 1.0  # s, of diagnostics
HEARD = (
    (DRIVER_STATE, DriverState, ALL_LATCHED),
    (JOINT_STATES, JointState, DEEP),
    (PRESSURES, CylinderPressures, DEEP),
    (COMMANDS, ValveCommand, DEEP),
    (OUTPUTS, ValveCommand, DEEP),
)
SENT = len(HEARD) - 1  # place of what the driver sent to the valves
LETTING_THROUGH = (DriverState.STATE_ENABLED, DriverState.STATE_DEGRADED)
WRONG_POSITION = (DriverState.FAULT_FROZEN, DriverState.FAULT_JUMPED, DriverState.FAULT_LYING)
VISIT = 0.01  # s between two visits to the queues
UNNOTICED = 1.0  # s, for which an encoder may have been wrong before the driver says so
SILENCE = 0.5  # s without pressures, after which they are reported as lost

MODEL = Text(
    "model", "", "Model file with hydraulics; empty: model.yaml of the machine. At configure"
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


class PositionSensorNode(LifecycleNode):
    """Listens to pressures, commands and encoders, and tells where the joints are."""

    def __init__(self) -> None:
        super().__init__("position_sensor")
        declare(self, PARAMETERS, read_only=(AUTOSTART, MACHINE))
        self._model: Model | None = None
        self._sensor: PositionSensor | None = None
        hold(self, PARAMETERS, lambda: "configured" if self._model else "unconfigured")
        self._hidden = np.zeros(0, dtype=bool)
        self._queues: list[tuple[int, Polled]] = []
        self._commanded = np.zeros(0)
        self._lost: set[str] = set()  # joints whose encoders the driver does not believe
        self._closed = False  # the driver says that commands do not reach the valves
        self._outputs_heard = False  # the driver tells what it sends to the valves
        self._zero, self._heard = 0, 0.0
        self._told: Told | None = None
        self._states = self.create_lifecycle_publisher(JointState, "joint_states_estimated", DEEP)
        self._estimates = self.create_lifecycle_publisher(
            PositionEstimate, "position_estimate", DEEP
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(VISIT, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._report, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read model and parameters; refused where the model has no hydraulics."""
        try:
            file = machine_file("model.yaml", MACHINE.read(self), MODEL.read(self))
            model = load_model(file)
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
            PositionSensor(model, np.zeros(len(model.joints)))  # refuses what it cannot use
            self._hidden = np.isin(model.joints, without)
            self._model = model
        except CraneError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen, from where the crane is said to be."""
        self._queues = [
            (order, Polled(self, msgtype, topic, qos))
            for order, (topic, msgtype, qos) in enumerate(HEARD)
        ]
        self._sensor = self._told = None
        self._lost = set()
        self._commanded, self._closed = np.zeros(len(self._hidden)), False
        self._outputs_heard = False
        self._heard = time.monotonic()
        say_ready(self)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more; where the crane is has to be found anew."""
        for _, queue in self._queues:
            queue.close()
        self._queues, self._sensor = [], None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the model."""
        self._model = None
        return super().on_cleanup(state)

    def _visit(self) -> None:
        if self._model is None:
            return
        came = [
            (nanoseconds(message.header.stamp), order, message)
            for order, queue in self._queues
            for message, _ in queue.take()
        ]
        for stamp, order, message in sorted(came, key=lambda one: one[:2]):
            self._take(stamp, message, sent=order == SENT)

    def _take(
        self,
        stamp: int,
        message: JointState | CylinderPressures | ValveCommand | DriverState,
        sent: bool,
    ) -> None:
        """`sent`: by the driver to the valves, which is believed rather than what was asked."""
        assert self._model is not None
        joints = self._model.joints
        match message:
            case JointState():
                encoders = picked(joints, message.name, message.position)
                encoders[self._hidden | np.isin(joints, list(self._lost))] = np.nan
                self._start(stamp, encoders)
                if self._sensor is not None:
                    self._sensor.add_encoders((stamp - self._zero) / NANOSECONDS, encoders)
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
                self._heard = time.monotonic()
                self._start(stamp, None)
                if self._sensor is not None:
                    self._weigh(stamp, message)

    def _judge(self, stamp: int, message: DriverState) -> None:
        """Which encoders the driver believes."""
        assert self._model is not None
        lost = {message.substituted}
        if message.fault in WRONG_POSITION:
            lost.add(message.source)
        for j, joint in enumerate(self._model.joints):
            if self._sensor is None:
                break
            if joint not in lost:
                self._sensor.believe(j)
            elif joint not in self._lost:
                since = (stamp - self._zero) / NANOSECONDS - UNNOTICED
                self._sensor.distrust(j, since)
        self._lost = lost

    def _command(self, stamp: int) -> None:
        """What reaches the valves from now on."""
        if self._sensor is not None:
            through = self._outputs_heard or not self._closed
            reaching = self._commanded if through else np.zeros_like(self._commanded)
            self._sensor.add_command((stamp - self._zero) / NANOSECONDS, reaching)

    def _start(self, stamp: int, encoders: np.ndarray | None) -> None:
        """Once, with the first encoders, or where `start` says it without them."""
        if self._sensor is not None or self._model is None:
            return
        given = POSITION.read(self)
        if given:
            position = np.array(given)
        elif encoders is not None:
            position = encoders
        elif self._hidden.all():
            position = np.full(len(self._hidden), np.nan)
        else:
            return
        self._zero = stamp
        self._sensor = PositionSensor(
            self._model, position, DEVIATION.read(self), heaviest=HEAVIEST_LOAD.read(self)
        )

    def _weigh(self, stamp: int, message: CylinderPressures) -> None:
        assert self._model is not None and self._sensor is not None
        joints = self._model.joints
        told = self._sensor.add_pressures(
            (stamp - self._zero) / NANOSECONDS,
            picked(joints, message.name, message.chamber_a),
            picked(joints, message.name, message.chamber_b),
            message.supply,
        )
        if told is None:
            return
        if self._told is None or told.condition is not self._told.condition:
            self.get_logger().info(told.condition.value)
        self._told = told
        self._states.publish(states_message(joints, told, stamp))
        self._estimates.publish(estimate_message(joints, told, stamp))

    def _report(self) -> None:
        found = DiagnosticStatus(name=f"{full_name(self)}: positions", level=DiagnosticStatus.OK)
        silent = time.monotonic() - self._heard
        if self._model is None:
            found.message = "not configured"
        elif self._told is None or self._sensor is None or silent > SILENCE:
            found.level = DiagnosticStatus.WARN
            found.message = SensorCondition.WAITING.value
        else:
            told = self._told
            blind = [
                joint
                for joint, seen in zip(self._model.joints, told.observable, strict=True)
                if not seen
            ]
            found.message = told.condition.value
            if blind:
                found.message += f"; not observable: {', '.join(blind)}"
            if blind or told.condition is not SensorCondition.GOOD:
                found.level = DiagnosticStatus.WARN
            found.values = [
                KeyValue(key="load [kg]", value=f"{told.estimate.load:.1f}"),
                KeyValue(key="load, standard deviation [kg]",
                         value=f"{told.estimate.deviation[-1]:.1f}"),
                KeyValue(key="late [-]", value=str(self._sensor.late)),
                KeyValue(key="invalid [-]", value=str(self._sensor.invalid)),
            ]  # fmt: skip
        self._diagnostics.publish(report_message(found, self.get_clock().now().to_msg()))


ABOUT = """Estimates positions, velocities and the load at the tip from cylinder_pressures,
valve_output (without a driver that tells it valve_command, while driver/state lets it through) and
the encoders in joint_states that are left, by a model with hydraulics. Publishes
joint_states_estimated and position_estimate."""


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions without encoders."""
    return run_managed("position_sensor", PositionSensorNode, ABOUT, PARAMETERS, argv)
