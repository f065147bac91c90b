"""`identification`: the online estimator as a managed node."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from crane_bags.clocks import NANOSECONDS, TimeBack
from crane_identification.data.column_map import ColumnMap
from crane_identification.online.estimator import OnlineEstimator, OnlineOptions
from crane_identification.online.recent import Recent, Watched
from crane_identification.online.recursion import Solution
from crane_identification.online.topics import (
    Listener,
    estimate_message,
    forces_message,
    listeners,
    mapped_listeners,
)
from crane_identification.recording_check.suspicion import Checked
from crane_interfaces.msg import GeneralizedForces, ParameterEstimate
from crane_model.configuration import load
from crane_model.errors import CraneError, DataError
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model, save_model
from crane_nodes.executor import Polled
from crane_nodes.managed import AUTOSTART, full_name, run_managed, say_ready
from crane_nodes.node_time import NodeTime, Pacing, tell_back
from crane_nodes.parameters import MACHINE, NodeParameter, Number, Numbers, Text, declare, hold

MATCHED_SHARE = 0.99
"""Share of positions with pressures below which something is wrong with stamps or topics."""
STATE_TOPIC, PRESSURE_TOPIC = "joint_states", "cylinder_pressures"
DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
SERIES = QoSProfile(
    depth=10,  # no estimate is lost while a process of the computer is starved
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
PUBLISH = 1.0  # s, of diagnostics
AHEAD = 1.0  # s, by which simulated time may be ahead of what was learned
VISIT = 0.05  # s between two visits to the queues, which hold 100 times as much
DEFAULTS = OnlineOptions()
MODEL_FILE = Text(
    "model", "", "Model file to identify; empty: model.yaml of the machine. At configure"
)
MODEL_OUTPUT = Text(
    "model_output", "identified_model.yaml", "File that ~/save_model writes, replacing it"
)
COLUMN_MAP_FILE = Text(
    "columns", "", "Column map of the topics to listen to; empty: those of the suite. At configure"
)
FORGETTING = Number(
    "forgetting",
    DEFAULTS.forgetting,
    "-",
    0.9,
    1.0,
    "Forgetting factor per row; the memory is period/(1 - forgetting). At configure",
)
LAG = Number(
    "lag",
    DEFAULTS.lag,
    "s",
    0.05,
    2.0,
    "Half the window of a row, four times that of the smoother. At configure",
)
PERIOD = Number(
    "period", DEFAULTS.period, "s", 0.005, 1.0, "Time from row to row, at most lag. At configure"
)
LARGEST_STREAM_GAP = Number(
    "largest_gap",
    DEFAULTS.largest_gap,
    "s",
    0.001,
    0.25,
    "Time without readings after which smoothing starts again, at most lag/8. At configure",
)
TIMEOUT = Number(
    "timeout", 1.0, "s", 0.1, 60.0, "Silence of a topic that is reported as a warning. At configure"
)
ENCODER_RESOLUTION = Numbers(
    "encoder_resolution",
    (),
    "rad or m",
    1e-9,
    0.1,
    "One count of the encoder of each joint of the model, in its order; empty: by sensors.yaml of "
    "the machine. At configure",
)
PARAMETERS: tuple[NodeParameter, ...] = (
    *(AUTOSTART, MACHINE, MODEL_FILE, COLUMN_MAP_FILE, MODEL_OUTPUT, FORGETTING),
    *(LAG, PERIOD, LARGEST_STREAM_GAP, ENCODER_RESOLUTION, TIMEOUT),
)
ABOUT = """Identifies the parameters of the crane from joint_states and cylinder_pressures, or
from the topics that a column map names, while it moves, and publishes them with standard
deviations on parameter_estimate."""


class Condition:
    """When the topics were last heard, by the steady clock, and what was wrong with them."""

    def __init__(self, timeout: float = 1.0):
        self.timeout = timeout
        self.problems: dict[str, str] = {}
        self._heard: dict[str, float] = {}

    def listen(self, now: float, *topics: str) -> None:
        """From now on, these topics and no others are expected."""
        self._heard = dict.fromkeys(topics, now)
        self.problems = {}

    def arrived(self, topic: str, now: float) -> None:
        self._heard[topic] = now

    def problem(self, topic: str, text: str) -> bool:
        """Something is wrong with a topic; True if that is news."""
        known = self.problems.get(topic)
        self.problems[topic] = text
        return known != text

    def well(self, topic: str) -> None:
        self.problems.pop(topic, None)

    def silent(self, now: float) -> list[str]:
        """Topics that were not heard for too long, and for how long."""
        return [
            f"{topic} silent for {now - heard:.1f} s"
            for topic, heard in self._heard.items()
            if now - heard > self.timeout
        ]


def status(
    name: str,
    condition: Condition,
    estimator: OnlineEstimator | None,
    solution: Solution | None,
    now: float,
) -> DiagnosticStatus:
    """The state of the estimation in one line, and its counters."""
    found = DiagnosticStatus(name=f"{name}: recursion", level=DiagnosticStatus.OK)
    if estimator is None:
        found.message = "not configured"
        return found
    matcher = estimator.matcher
    seen = matcher.matched + matcher.unmatched
    unknown = len(estimator.model.parameters)
    if solution is not None:
        unknown = int((~solution.determined).sum())
    warnings = condition.silent(now)
    if seen and matcher.matched < MATCHED_SHARE * seen:
        warnings.append(f"{matcher.unmatched} of {seen} positions without pressures of their time")
    if condition.problems:
        found.level = DiagnosticStatus.ERROR
        found.message = "; ".join(condition.problems.values())
    elif warnings:
        found.level = DiagnosticStatus.WARN
        found.message = "; ".join(warnings)
    elif unknown:
        found.message = f"{unknown} parameters not determined yet"
    else:
        found.message = "all parameters determined"
    values = {
        "samples [-]": estimator.samples,
        "gated share [-]": f"{estimator.gated_share:.3f}",
        "unmatched [-]": matcher.unmatched,
        "repeated [-]": matcher.repeated + estimator.smoother.repeated,
        "invalid [-]": estimator.invalid,
        "runs [-]": estimator.smoother.run + 1,
        "undetermined [-]": unknown,
        "condition number, normalised [-]": f"{_condition_number(solution):.4g}",
    }
    found.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return found


def recording(name: str, found: Checked | None) -> DiagnosticStatus:
    """Report suspicious signals."""
    told = DiagnosticStatus(name=f"{name}: recording", level=DiagnosticStatus.OK)
    if found is None:
        told.message = "too little heard yet"
    elif found.suspicions:
        told.level = DiagnosticStatus.ERROR if found.decisive else DiagnosticStatus.WARN
        told.message = "; ".join(str(suspicion) for suspicion in found.suspicions)
    else:
        told.message = f"nothing suspicious in {found.source}"
    if found is not None:
        told.values = [KeyValue(key="not checked", value="; ".join(found.unchecked))]
    return told


def _condition_number(solution: Solution | None) -> float:
    return math.inf if solution is None else solution.condition_number


class Identification(LifecycleNode):
    """Learns from positions and chamber pressures, tells what it knows once a second."""

    def __init__(self) -> None:
        super().__init__("identification")
        declare(self, PARAMETERS, read_only=(AUTOSTART, MACHINE))
        self._estimator: OnlineEstimator | None = None
        self._recent: Recent | None = None
        self._back = TimeBack()
        self._set_backs = 0  # that were told
        fixed = [parameter for parameter in PARAMETERS if parameter is not MODEL_OUTPUT]
        hold(self, fixed, lambda: "configured" if self._estimator else "unconfigured")
        self._second = -1  # of the data, in which the estimate was published
        self._samples = self._told = 0  # rows: at the last look, in the newest estimate
        self._time = NodeTime(self)
        self._time.listen()
        self._pacing: Pacing | None = None
        self._condition = Condition()
        self._listeners: tuple[Listener, ...] = ()
        self._listening: list[tuple[Polled, Callable[[Any, int], None]]] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._estimates = self.create_lifecycle_publisher(
            ParameterEstimate, "parameter_estimate", SERIES if self._time.simulated else LATCHED
        )
        self._forces = self.create_lifecycle_publisher(
            GeneralizedForces, "generalized_forces", DEEP
        )
        self.create_service(Trigger, "~/reset_estimator", self._reset)
        self.create_service(Trigger, "~/save_model", self._save)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(VISIT, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._tell, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            options = OnlineOptions(
                lag=LAG.read(self),
                period=PERIOD.read(self),
                forgetting=FORGETTING.read(self),
                largest_gap=LARGEST_STREAM_GAP.read(self),
                encoder_resolution=ENCODER_RESOLUTION.read(self) or None,
                machine=MACHINE.read(self),
            )
            self._condition = Condition(timeout=TIMEOUT.read(self))
            file = machine_file("model.yaml", options.machine, MODEL_FILE.read(self))
            estimator = OnlineEstimator(load_model(file).of_machine(), options)
            recent = Recent(estimator.model.machine, estimator.model.joints)
            watched = Watched(estimator, recent)
            self._listeners = self._listeners_of(watched)
            self._back, self._set_backs = watched.back, 0
            self._estimator, self._recent = estimator, recent
        except CraneError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen; what was learned before a deactivation is kept."""
        self._listening = [
            (Polled(self, listener.msgtype, listener.topic, DEEP), self._learner(listener))
            for listener in self._listeners
        ]
        topics = [listener.topic for listener in self._listeners]
        self._condition.listen(self._time.now(), *topics)
        self._pacing = Pacing(self, self._time, AHEAD)
        say_ready(self)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._condition.listen(self._time.now())
        if self._pacing is not None:
            self._pacing.close()
            self._pacing = None
        for topic, _ in self._listening:
            topic.close()
        self._listening = []
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._estimator = self._recent = None
        return super().on_cleanup(state)

    def _visit(self) -> None:
        for topic, learn in self._listening:
            for message, about in topic.take():
                learn(message, about["source_timestamp"])
        if self._pacing is not None:
            self._pacing.taken()

    def _listeners_of(self, estimator: Watched) -> tuple[Listener, ...]:
        file = COLUMN_MAP_FILE.read(self)
        if not file:
            return listeners(
                estimator, *map(self.resolve_topic_name, (STATE_TOPIC, PRESSURE_TOPIC))
            )
        return mapped_listeners(estimator, load(file, ColumnMap), file)

    def _learner(self, listener: Listener) -> Callable[[Any, int], None]:
        def learn(message: Any, sent: int) -> None:
            self._condition.arrived(listener.topic, self._time.now())
            try:
                forces = listener.take(message, sent)
            except DataError as error:
                if self._condition.problem(listener.topic, str(error)):
                    self.get_logger().error(str(error))
                return
            self._condition.well(listener.topic)
            if self._back.times != self._set_backs:
                self._set_backs = self._back.times
                self.get_logger().warning(str(self._back))
            assert self._estimator is not None
            for force in forces:
                self._forces.publish(forces_message(self._estimator.model.joints, force))
                if (
                    force.stamp // NANOSECONDS != self._second
                ):  # of the data: a repetition tells the same
                    self._second = force.stamp // NANOSECONDS
                    self._publish_estimate()

        return learn

    def _publish_estimate(self) -> None:
        assert self._estimator is not None
        self._estimates.publish(estimate_message(self._estimator, self._estimator.solve()))
        self._told = self._estimator.samples

    def _tell(self) -> None:
        """Publish diagnostics, and the estimate on data that have ended within a second."""
        solution = None
        if self._estimator is not None and (samples := self._estimator.samples):
            solution = self._estimator.solve()
            ended, self._samples = samples == self._samples, samples
            if ended and samples != self._told and not self._time.simulated:
                self._publish_estimate()
        found = status(
            full_name(self), self._condition, self._estimator, solution, self._time.now()
        )
        tell_back(self._back, found)
        if self._recent is not None:
            self._recent.check()
        checked = recording(full_name(self), self._recent.found if self._recent else None)
        message = DiagnosticArray(status=[found, checked])
        message.header.stamp = self._time.stamp()
        self._diagnostics.publish(message)

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._estimator is None:
            response.message = "nothing to reset: the node is not configured"
            return response
        self._estimator.reset()
        response.success, response.message = True, "estimate and counters start again"
        return response

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._estimator is None:
                raise DataError("nothing to save: the node is not configured")
            file = Path(MODEL_OUTPUT.read(self)).absolute()
            save_model(file, self._estimator.fitted_model())
        except (CraneError, OSError) as error:
            response.message = str(error)
            return response
        response.success, response.message = True, f"wrote {file}"
        return response


def main(argv: Sequence[str] | None = None) -> int:
    """Identify the crane's parameters from joint_states and cylinder_pressures."""
    return run_managed("identification", Identification, ABOUT, PARAMETERS, argv)
