"""What the managed nodes of this package have in common: lifecycle, queues, a report a second."""

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS, TimeBack
from crane_interfaces.msg import PositionEstimate, SensorFindings, TipLoad
from crane_model.array import Array
from crane_model.errors import CraneError
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, say_ready
from crane_nodes.names import full_name
from crane_nodes.node_time import NodeTime, Pacing, nanoseconds, stamp_of, tell_back
from crane_nodes.parameters import NodeParameter, declare, hold
from crane_nodes.polled import Polled
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.signatures import Part
from crane_observer.position.sensor import Told
from crane_observer.scale.scale import Weighing

# Messages of several topics in the order of their stamps, whatever delay each topic has.

M = TypeVar("M")
LONGEST = 100_000_000  # ns, that one topic is waited for when others have gone on, unless told


class Stamped(NamedTuple, Generic[M]):
    """A message, its stamp [ns] and the place of its topic."""

    stamp: int
    topic: int
    message: M


class InOrder(Generic[M]):
    """Holds messages back until every topic that talks has come as far, or is late by `longest` ns.

    A valve command that arrives a moment after the pressures that it made is so put before them.
    """

    def __init__(self, longest: int = LONGEST) -> None:
        self._longest = longest
        self._held: list[Stamped[M]] = []
        self._newest: dict[int, int] = {}  # ns, by topic

    def add(self, stamp: int, topic: int, message: M) -> None:
        """It has come."""
        self._held.append(Stamped(stamp, topic, message))
        self._newest[topic] = max(stamp, self._newest.get(topic, stamp))

    def take(self) -> list[Stamped[M]]:
        """Those whose turn it is, the oldest first."""
        if not self._held:
            return []
        latest = max(self._newest.values())
        talking = [newest for newest in self._newest.values() if latest - newest < self._longest]
        until = min(talking)
        self._held.sort(key=lambda one: one[:2])
        count = sum(one.stamp <= until for one in self._held)
        taken, self._held = self._held[:count], self._held[count:]
        return taken


# Topics of the observers: names, qualities, from messages to readings and back.

JOINT_STATES, PRESSURES, COMMANDS = "joint_states", "cylinder_pressures", "valve_command"
OUTPUTS = "valve_output"
DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def report_message(found: DiagnosticStatus, stamp: Time) -> DiagnosticArray:
    """What a node says of itself."""
    message = DiagnosticArray(status=[found])
    message.header.stamp = stamp
    return message


def picked(joints: Sequence[str], names: Sequence[str], values: Sequence[float]) -> Array:
    """(j,) of `values`, one a name; NaN of joints that are not named."""
    given = dict(zip(names, values, strict=False))
    return np.array([given.get(joint, np.nan) for joint in joints], dtype=float)


def states_message(joints: Sequence[str], told: Told, stamp: int) -> JointState:
    """Position and velocity of the joints of the model."""
    estimate = told.estimate
    message = JointState(
        name=list(joints),
        position=estimate.position.tolist(),
        velocity=estimate.velocity.tolist(),
    )
    message.header.stamp = stamp_of(stamp)
    return message


def estimate_message(joints: Sequence[str], told: Told, stamp: int) -> PositionEstimate:
    """How far they are to be believed."""
    estimate = told.estimate
    deviation = estimate.deviation
    message = PositionEstimate(
        name=list(joints),
        position=estimate.position.tolist(),
        velocity=estimate.velocity.tolist(),
        std_dev=deviation[:-1].tolist(),
        measured=told.measured.tolist(),
        observable=told.observable.tolist(),
        covariance=estimate.covariance.ravel().tolist(),
        load=estimate.load,
        load_std_dev=float(deviation[-1]),
        condition=told.condition.name,
    )
    message.header.stamp = stamp_of(stamp)
    return message


def findings_message(findings: Sequence[SensorFinding], zero: int) -> SensorFindings:
    """All of them; their times count from `zero` [ns]."""

    message = SensorFindings(
        sensor=[one.sensor for one in findings],
        joint=[_joint(one) for one in findings],
        kind=[str(one.kind) for one in findings],
        unit=[one.unit for one in findings],
        size=[one.size for one in findings],
        low=[one.low for one in findings],
        high=[one.high for one in findings],
        onset=[zero / NANOSECONDS + one.onset for one in findings],
        dangerous=[one.dangerous for one in findings],
        what_to_do=[one.what_to_do for one in findings],
    )
    if findings:
        newest = max(one.found for one in findings)
        message.header.stamp = stamp_of(zero + round(newest * NANOSECONDS))
    return message


def _joint(finding: SensorFinding) -> str:
    """Whose position is in doubt, of a supply that may be an encoder."""
    if finding.rival is not None:
        return finding.rival.joint
    return "" if finding.part is Part.SUPPLY else finding.joint


def load_message(weighing: Weighing, zero: int) -> TipLoad:
    """What hangs at the tip; its time counts from `zero` [ns]."""
    load = weighing.load
    message = TipLoad(
        load=load.mass,
        std_dev=load.deviation,
        centre=load.centre,
        centre_std_dev=load.centre_deviation,
        moved=weighing.moved,
        changed=weighing.changed,
        condition=weighing.condition.name,
    )
    message.header.stamp = stamp_of(zero + round(weighing.time * NANOSECONDS))
    return message


PUBLISH = 1.0  # s, of diagnostics
AHEAD = 0.05  # s, by which simulated time may be ahead: the driver moves joints by estimates
HeardTopic: TypeAlias = tuple[str, type, QoSProfile]


class ObserverNode(LifecycleNode):
    """Listens while it is active; a node says by `read` to `report` what becomes of that.

    If the stamps of a topic go back, it begins anew.
    """

    def __init__(
        self,
        name: str,
        parameters: Sequence[NodeParameter],
        heard: Sequence[HeardTopic],
        visit: float,
        tells: str,
    ):
        """`heard` is looked at every `visit` s; `tells` names the status on /diagnostics."""
        super().__init__(name)
        declare(self, parameters, read_only=(AUTOSTART, MACHINE))
        self._configured = self._active = False
        hold(self, parameters, lambda: "configured" if self._configured else "unconfigured")
        self.clock = NodeTime(self)
        self.clock.listen()
        self._pacing: Pacing | None = None
        self._back = TimeBack()
        self._set_backs = 0  # that were told
        self._heard, self._tells = heard, tells
        self._queues: list[Polled] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(visit, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._report, clock=steady)

    def read(self) -> None:
        """Files and parameters; `CraneError` or `OSError` keeps the node unconfigured."""
        raise NotImplementedError

    def begin(self) -> None:
        """Before anything is heard."""
        raise NotImplementedError

    def end(self) -> None:
        """After everything was heard."""

    def hear(self, topic: int, message: Any) -> None:
        """A message of the topic at this place of those that are heard."""
        raise NotImplementedError

    def tell(self) -> None:
        """What follows from what was heard since the last visit."""
        raise NotImplementedError

    def report(self, status: DiagnosticStatus) -> None:
        """How an active node is doing, into a status that is OK and says nothing yet."""
        raise NotImplementedError

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read; refused where that fails."""
        try:
            self.read()
        except (CraneError, OSError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen; nothing is known yet."""
        activated = super().on_activate(state)
        self._queues = [Polled(self, msgtype, topic, qos) for topic, msgtype, qos in self._heard]
        self._back, self._set_backs = TimeBack(), 0
        self.begin()
        self._active = True
        self._pacing = Pacing(self, self.clock, AHEAD)
        say_ready(self)
        return activated

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more; what was found is forgotten."""
        for queue in self._queues:
            queue.close()
        self._queues = []
        if self._pacing is not None:
            self._pacing.close()
        self._finish()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Another model may be read."""
        self._configured = False
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave nothing half done."""
        self._finish()
        return super().on_shutdown(state)

    def _finish(self) -> None:
        if self._active:
            self._active = False
            self.end()

    def _visit(self) -> None:
        if not self._active:
            return
        for topic, queue in enumerate(self._queues):
            for message, _ in queue.take():
                if self._back.comes(self._heard[topic][0], nanoseconds(message.header.stamp)):
                    if self._back.times != self._set_backs:
                        self._set_backs = self._back.times
                        self.get_logger().warning(str(self._back))
                    self.end()
                    self.begin()
                self.hear(topic, message)
        self.tell()
        if self._pacing is not None:
            self._pacing.taken()

    def _report(self) -> None:
        status = DiagnosticStatus(
            name=f"{full_name(self)}: {self._tells}", level=DiagnosticStatus.OK
        )
        if self._active:
            self.report(status)
            tell_back(self._back, status)
        else:
            status.message = "not active"
        self._diagnostics.publish(report_message(status, self.clock.stamp()))
