"""`position_sensor`: positions and the load at the tip as a managed node."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

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
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.node_time import nanoseconds
from crane_nodes.parameters import NodeParameter, Number, Numbers, Text
from crane_observer.node.observer_node import (
    COMMANDS,
    DEEP,
    JOINT_STATES,
    OUTPUTS,
    PRESSURES,
    InOrder,
    ObserverNode,
    estimate_message,
    picked,
    states_message,
)
from crane_observer.position.hypotheses import HEAVIEST, refuse_unserved
from crane_observer.position.sensor import START, PositionSensor, SensorCondition, Told

# What the position sensor hears on its topics, in order, as readings of joints.

DRIVER_STATE = "driver/state"
ALL_LATCHED = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
HEARD = (
    (DRIVER_STATE, DriverState, ALL_LATCHED),
    (JOINT_STATES, JointState, DEEP),
    (PRESSURES, CylinderPressures, DEEP),
    (COMMANDS, ValveCommand, DEEP),
    (OUTPUTS, ValveCommand, DEEP),
)
Heard: TypeAlias = JointState | CylinderPressures | ValveCommand | DriverState
SENT = len(HEARD) - 1  # place of what the driver sent to the valves
LETTING_THROUGH = (DriverState.STATE_ENABLED, DriverState.STATE_DEGRADED)
WRONG_POSITION = (DriverState.FAULT_FROZEN, DriverState.FAULT_JUMPED, DriverState.FAULT_LYING)
UNNOTICED = 1.0  # s, for which an encoder may have been wrong before the driver says so
PATIENCE = 20_000_000  # ns, that a topic is waited for: what is told late moves no joint


@dataclass(frozen=True)
class Beginning:
    """What a position sensor begins from."""

    model: Model
    hidden: Flags  # (j,) joints whose encoders are not to be used
    position: Array | None  # (j,) rad, m; None: by the encoders
    deviation: float  # rad, m
    heaviest: float  # kg


class StampedTold(NamedTuple):
    """What a message with this stamp [ns] completed."""

    stamp: int
    told: Told


class PositionHearing:
    """From messages to a position sensor, which it makes with the first that says where the crane
    is.
    """

    def __init__(self, beginning: Beginning):
        self.sensor: PositionSensor | None = None
        self._begin = beginning
        self._came: InOrder[Heard] = InOrder(PATIENCE)
        self._commanded = np.zeros(len(beginning.hidden))
        self._lost: set[str] = set()  # joints whose encoders the driver does not believe
        self._closed = False  # the driver says that commands do not reach the valves
        self._outputs_heard = False  # the driver tells what it sends to the valves
        self._zero = 0

    def add(self, topic: int, message: Heard) -> None:
        """It has come on this one of HEARD."""
        self._came.add(nanoseconds(message.header.stamp), topic, message)

    def take(self) -> Iterator[StampedTold]:
        """What those whose turn it is complete."""
        for stamp, topic, message in self._came.take():
            told = self._take(stamp, message, sent=topic == SENT)
            if told is not None:
                yield StampedTold(stamp, told)

    def _take(self, stamp: int, message: Heard, sent: bool) -> Told | None:
        """`sent`: by the driver to the valves, which is believed rather than what was asked."""
        joints = self._begin.model.joints
        match message:
            case JointState():
                encoders = picked(joints, message.name, message.position)
                encoders[self._begin.hidden | np.isin(joints, list(self._lost))] = np.nan
                if sensor := self._started(stamp, encoders):
                    sensor.add_encoders(self._seconds(stamp), encoders)
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
                if sensor := self._started(stamp, None):
                    return sensor.add_pressures(
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
        for j, joint in enumerate(self._begin.model.joints):
            if self.sensor is None:
                break
            if joint not in lost:
                self.sensor.believe(j)
            elif joint not in self._lost:
                self.sensor.distrust(j, self._seconds(stamp) - UNNOTICED)
        self._lost = lost

    def _command(self, stamp: int) -> None:
        """What reaches the valves from now on."""
        if self.sensor is not None:
            through = self._outputs_heard or not self._closed
            reaching = self._commanded if through else np.zeros_like(self._commanded)
            self.sensor.add_command(self._seconds(stamp), reaching)

    def _started(self, stamp: int, encoders: Array | None) -> PositionSensor | None:
        """The sensor: made once, with the first encoders, or where it is said without them."""
        begin = self._begin
        if self.sensor is not None:
            return self.sensor
        if begin.position is not None:
            position = begin.position
        elif encoders is not None:
            position = encoders
        elif begin.hidden.all():
            position = np.full(len(begin.hidden), np.nan)
        else:
            return None
        self._zero = stamp
        self.sensor = PositionSensor(
            begin.model, position, begin.deviation, heaviest=begin.heaviest
        )
        return self.sensor


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
