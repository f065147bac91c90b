"""What the position sensor hears on its topics, in order, as readings of joints."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import CylinderPressures, DriverState, ValveCommand
from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_nodes.stamps import nanoseconds
from crane_observer.node.in_order import InOrder
from crane_observer.node.topics import COMMANDS, DEEP, JOINT_STATES, OUTPUTS, PRESSURES, picked
from crane_observer.position.sensor import PositionSensor, Told

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
