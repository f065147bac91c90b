"""Common parts of the managed nodes: lifecycle, ordered messages, a report a second."""

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS, TimeBack
from crane_interfaces.msg import (
    CylinderPressures,
    PositionEstimate,
    SensorFindings,
    TipLoad,
    ValveCommand,
)
from crane_model.array import Array
from crane_model.errors import CraneError
from crane_nodes.executor import Polled
from crane_nodes.managed import AUTOSTART, full_name, say_ready
from crane_nodes.node_time import NodeTime, Pacing, nanoseconds, stamp_of, tell_back
from crane_nodes.parameters import MACHINE, NodeParameter, declare, hold
from crane_observer.monitor.finding import Part, SensorFinding
from crane_observer.payload.estimator import PayloadEstimate
from crane_observer.position.estimator import WindowEstimate

M = TypeVar("M")
LONGEST_WAIT = 100_000_000  # ns, that one topic is waited for when others have gone on
REPORT_PERIOD = 1.0  # s, of diagnostics; a topic of which nothing came for as long is named
LARGEST_LEAD = 0.05  # s, by which simulated time may be ahead: the driver moves joints by estimates

DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class HeardTopic(NamedTuple):
    """A topic that a node listens to."""

    name: str
    type: type
    qos: QoSProfile = DEEP


JOINT_STATES = HeardTopic("joint_states", JointState)
PRESSURES = HeardTopic("cylinder_pressures", CylinderPressures)
COMMANDS = HeardTopic("valve_command", ValveCommand)
OUTPUTS = HeardTopic("valve_output", ValveCommand)


class Stamped(NamedTuple, Generic[M]):
    """A message, its stamp [ns] and the place of its topic."""

    stamp: int
    topic: int
    message: M


class InOrder(Generic[M]):
    """Messages of several topics in the order of their stamps, whatever delay each topic has.

    Holds messages back until every topic that talks has come as far, or is late by `longest` ns. A
    valve command that arrives a moment after the pressures that it made is so put before them.
    """

    def __init__(self, longest: int = LONGEST_WAIT) -> None:
        self._longest = longest
        self._held: list[Stamped[M]] = []
        self._newest: dict[int, int] = {}  # ns, by topic

    def add(self, stamp: int, topic: int, message: M) -> None:
        self._held.append(Stamped(stamp, topic, message))
        self._newest[topic] = max(stamp, self._newest.get(topic, stamp))

    def take(self) -> list[Stamped[M]]:
        """Those whose turn it is, the oldest first."""
        if not self._held:
            return []
        latest = max(self._newest.values())
        until = min(newest for newest in self._newest.values() if latest - newest < self._longest)
        self._held.sort(key=lambda held: held[:2])
        count = sum(held.stamp <= until for held in self._held)
        taken, self._held = self._held[:count], self._held[count:]
        return taken


def picked(joints: Sequence[str], names: Sequence[str], values: Sequence[float]) -> Array:
    """(j,) of `values`, one a name; NaN of joints that are not named."""
    given = dict(zip(names, values, strict=False))
    return np.array([given.get(joint, np.nan) for joint in joints], dtype=float)


def states_message(joints: Sequence[str], told: WindowEstimate, stamp: int) -> JointState:
    """Position and velocity of the joints of the model."""
    position, velocity = told.estimate.position.tolist(), told.estimate.velocity.tolist()
    message = JointState(name=list(joints), position=position, velocity=velocity)
    message.header.stamp = stamp_of(stamp)
    return message


def estimate_message(joints: Sequence[str], told: WindowEstimate, stamp: int) -> PositionEstimate:
    """The same, and how far they are to be believed."""
    estimate, deviation = told.estimate, told.estimate.deviation
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
        sensor=[finding.sensor for finding in findings],
        joint=[_joint(finding) for finding in findings],
        kind=[str(finding.kind) for finding in findings],
        unit=[finding.unit for finding in findings],
        size=[finding.size for finding in findings],
        low=[finding.low for finding in findings],
        high=[finding.high for finding in findings],
        onset=[zero / NANOSECONDS + finding.onset for finding in findings],
        dangerous=[finding.dangerous for finding in findings],
        what_to_do=[finding.what_to_do for finding in findings],
    )
    if findings:
        newest = max(finding.found for finding in findings)
        message.header.stamp = stamp_of(zero + round(newest * NANOSECONDS))
    return message


def _joint(finding: SensorFinding) -> str:
    """Whose position is in doubt, of a supply that may be an encoder."""
    if finding.rival is not None:
        return finding.rival.joint
    return "" if finding.part is Part.SUPPLY else finding.joint


def load_message(payload: PayloadEstimate, zero: int) -> TipLoad:
    """Message of the payload; its time counts from `zero` [ns]."""
    load = payload.load
    message = TipLoad(
        load=load.mass,
        std_dev=load.deviation,
        centre=load.centre,
        centre_std_dev=load.centre_deviation,
        moved=payload.moved,
        changed=payload.changed,
        condition=payload.condition.name,
    )
    message.header.stamp = stamp_of(zero + round(payload.time * NANOSECONDS))
    return message


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
        longest_wait: int = LONGEST_WAIT,
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
        self._heard, self._tells, self._longest_wait = heard, tells, longest_wait
        self._came: InOrder[Any] = InOrder(longest_wait)
        self.outputs_heard = False  # the driver tells what it sends to the valves
        self._latest: dict[str, float] = {}  # s, when a message of each topic came
        self.zero: int | None = None  # ns, stamp of the first message
        self._queues: list[Polled] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(visit, self._visit, clock=steady)
        self.create_timer(REPORT_PERIOD, self._report, clock=steady)

    def read(self) -> None:
        """Files and parameters; `CraneError` or `OSError` keeps the node unconfigured."""
        raise NotImplementedError

    def begin(self) -> None:
        raise NotImplementedError

    def end(self) -> None:
        raise NotImplementedError

    def counts(self, topic: HeardTopic) -> bool:
        """Return whether a message that has just come counts.

        Requested commands do not, once the driver tells what it sends: they bear the time of their
        sender, whose clock may be wrong.
        """
        self.outputs_heard = self.outputs_heard or topic is OUTPUTS
        return not (self.outputs_heard and topic is COMMANDS)

    def take(self, stamp: int, topic: HeardTopic, message: Any) -> None:
        """A message whose turn it is, with its stamp [ns]."""
        raise NotImplementedError

    def report(self, status: DiagnosticStatus) -> None:
        """How an active node is doing, into a status that is OK and says nothing yet."""
        raise NotImplementedError

    def seconds(self, stamp: int) -> float:
        """Time of a stamp [ns] since the first message [s]."""
        return (stamp - (self.zero or 0)) / NANOSECONDS

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
        self._queues = [Polled(self, topic.type, topic.name, topic.qos) for topic in self._heard]
        self._back, self._set_backs = TimeBack(), 0
        self._begin()
        self._active = True
        self._pacing = Pacing(self, self.clock, LARGEST_LEAD)
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
        self._configured = False
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave nothing half done."""
        self._finish()
        return super().on_shutdown(state)

    def _begin(self) -> None:
        self._came, self.zero = InOrder(self._longest_wait), None
        self.outputs_heard = False
        self.begin()

    def _finish(self) -> None:
        if self._active:
            self._active = False
            self.end()

    def _visit(self) -> None:
        if not self._active:
            return
        for place, (topic, queue) in enumerate(zip(self._heard, self._queues, strict=True)):
            for message, _ in queue.take():
                self._latest[topic.name] = self.clock.now()
                if not self.counts(topic):
                    continue
                stamp = nanoseconds(message.header.stamp)
                if self._back.comes(topic.name, stamp):
                    if self._back.times != self._set_backs:
                        self._set_backs = self._back.times
                        self.get_logger().warning(str(self._back))
                    self.end()
                    self._begin()
                self._came.add(stamp, place, message)
        for stamp, place, message in self._came.take():
            self.zero = stamp if self.zero is None else self.zero
            self.take(stamp, self._heard[place], message)
        if self._pacing is not None:
            self._pacing.taken()

    def _silent(self) -> str:
        """Name the topics of which nothing came for a second."""
        since = self.clock.now() - REPORT_PERIOD
        silent = (
            topic.name for topic in self._heard if self._latest.get(topic.name, since) <= since
        )
        return ", ".join(silent)

    def _report(self) -> None:
        status = DiagnosticStatus(
            name=f"{full_name(self)}: {self._tells}", level=DiagnosticStatus.OK
        )
        if self._active:
            self.report(status)
            tell_back(self._back, status)
            status.values = [*status.values, KeyValue(key="silent topics", value=self._silent())]
        else:
            status.message = "not active"
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.clock.stamp()
        self._diagnostics.publish(message)
