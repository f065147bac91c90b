"""An operator of the live suite: begins experiments, unplugs an encoder, and sees who notices."""

import math
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.action import ActionClient
from rclpy.task import Future
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_bags.storage import blocks, open_bag
from crane_bags.types import DRIVER_STATE, SENSOR_FINDINGS, VALVE_OUTPUT, Topic, typestore
from crane_benchmark.rehearsal.crane_run import VALIDATION, CraneRun
from crane_benchmark.rehearsal.live_node import (
    LEADING,
    Onlooker,
    record_to,
    start,
    stop,
)
from crane_benchmark.rehearsal.outcome import LostEncoder
from crane_benchmark.rehearsal.processes import ProcessError, Processes
from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import DriverState, PositionEstimate, SensorFindings
from crane_interfaces.srv import SubstituteEncoder
from crane_nodes.driver_client import LATCHED
from crane_nodes.node_time import nanoseconds

OBSERVERS = ("position_estimator", "sensor_monitor")
LISTENERS = (*LEADING, *OBSERVERS)
KNOWN = 3.0  # s of motion, before the plug is pulled
FAST = 0.5  # of the joint's largest speed until then, at which it is pulled
MOVES = 0.02  # rad/s
AGREES = 0.05  # rad, between a repaired encoder and the estimate
LOOK_S = 0.02  # at most, for something that comes


class OperatorNode(Onlooker):
    """Hears the observers, and asks the driver for what an operator would."""

    def __init__(self, suite: Processes, domain: int):
        super().__init__(suite, domain)
        self.estimate = PositionEstimate()
        self.states = JointState()
        self.named: tuple[str, ...] = ()
        self.node.create_subscription(JointState, "joint_states", self._measured, 1)
        self.node.create_subscription(PositionEstimate, "position_estimate", self._estimated, 1)
        self.node.create_subscription(SensorFindings, "sensor_findings", self._found, LATCHED)
        self._action = ActionClient(self.node, RunExcitation, "run_excitation")
        self._ending: Future | None = None
        self._substitute = self.node.create_client(SubstituteEncoder, "driver/substitute")

    @property
    def now(self) -> int:
        """Stamp of what happens now [ns]."""
        return nanoseconds(self.clock.stamp())

    def position(self, joint: str) -> float:
        """By the estimate [rad, m]."""
        self._look()
        return float(self.estimate.position[list(self.estimate.name).index(joint)])

    def reads(self, joint: str) -> bool:
        """Return whether the encoder of a joint is read, near the estimate.

        Its jump to where the joint is has to be reset.
        """
        if self.in_state(DriverState.STATE_FAULT):
            self.reset()
        readings = dict(zip(self.states.name, self.states.position, strict=True))
        return abs(readings.get(joint, math.nan) - self.position(joint)) < AGREES

    def speed(self, joint: str) -> float:
        """By the estimate [rad/s, m/s]; 0 before it is known."""
        self._look()
        names = list(self.estimate.name)
        return abs(self.estimate.velocity[names.index(joint)]) if joint in names else 0.0

    def stopped_by(self, joint: str) -> bool:
        """Return whether the driver is in a fault that names this joint's encoder."""
        self._look()
        state = self.driver.state
        named = joint in self.named or state.source == joint
        return named and state.state == DriverState.STATE_FAULT

    def in_state(self, *states: int) -> bool:
        self._look()
        return self.driver.state.state in states

    def silent(self) -> bool:
        self._look()
        return self.node.count_publishers("valve_command") == 0

    def over(self) -> bool:
        self._look()
        return bool(self._ending and self._ending.done())

    def begin(self, trajectory: str) -> str:
        """Enable, and begin one period of a trajectory; why not, or empty.

        By this node, which the others know by now.
        """
        enabled = self._answer(self.driver.enable())
        if not (enabled and enabled.success):
            why = enabled.message if enabled else f"no answer within {self.patience:g} s"
            return f"the driver is not enabled: {why}"
        goal = RunExcitation.Goal(trajectory=trajectory, periods=1)
        handle = self._answer(self._action.send_goal_async(goal))
        if not (handle and handle.accepted):
            why = "refused" if handle else f"no answer within {self.patience:g} s"
            return f"the trajectory does not begin: {why}"
        self._ending = handle.get_result_async()
        return ""

    @property
    def ended(self) -> str:
        """Why the experiment ended."""
        result = self._ending.result() if self._ending and self._ending.done() else None
        return result.result.message if result else "it goes on"

    def substitute(self, joint: str) -> bool:
        """Ask the driver to go on without this joint's encoder, or with all; whether it does."""
        request = SubstituteEncoder.Request(joint=joint)
        answer = self._answer(self._substitute.call_async(request))
        return bool(answer and answer.success)

    def reset(self) -> bool:
        """Reset the driver's fault; whether it is gone."""
        self._answer(self.driver.reset_fault())
        return self.in_state(DriverState.STATE_DISABLED)

    def _look(self) -> None:
        self.executor.spin_once(timeout_sec=LOOK_S)

    def _answer(self, future: Future) -> Any:
        self.executor.spin_until_future_complete(future, timeout_sec=self.patience)
        return future.result()

    def _measured(self, message: JointState) -> None:
        self.states = message

    def _estimated(self, message: PositionEstimate) -> None:
        self.estimate = message

    def _found(self, message: SensorFindings) -> None:
        self.named = tuple(message.joint)


def pull_plug(
    suite: Processes, hand: OperatorNode, run: CraneRun, joint: str, listeners: Collection[str]
) -> int:
    """The plug, once the joint moves well; when [ns]."""
    hand.ready(listeners)
    if refused := hand.begin(str(run.file(VALIDATION).resolve())):
        raise suite.failed(refused, "driver")
    if not _moves_well(suite, hand, joint):
        raise suite.failed(f"the experiment ended early: {hand.ended}", "trajectory")
    suite.tell("crane", f"fault={joint}.encoder.stuck")
    at = hand.now
    suite.until(lambda: hand.stopped_by(joint), "nobody notices")
    suite.until(hand.over, "the experiment goes on")
    return at


def _moves_well(suite: Processes, hand: OperatorNode, joint: str) -> bool:
    """Wait until all is known and this joint is fast; whether the experiment still goes on."""
    largest, known = MOVES, math.inf

    def well() -> bool:
        nonlocal largest, known
        speed = hand.speed(joint)
        largest = max(largest, speed)
        if speed > MOVES:
            known = min(known, hand.clock.now() + KNOWN)
        return hand.clock.now() > known and speed > FAST * largest

    suite.until(lambda: hand.over() or well(), "no motion")
    return not hand.over()


def lose_encoder(
    suite: Processes, domain: int, run: CraneRun, seed: int, joint: str
) -> LostEncoder:
    """Freeze the encoder of a joint in mid-motion; `ProcessError` if nothing notices it."""
    use = "lost_encoder"
    with OperatorNode(suite, domain) as hand:
        led = ("-p", f"law:={run.controller}", "-p", f"model:={run.fitted}")
        start(suite, run, seed, *led, listeners=LISTENERS)
        for name in OBSERVERS:
            suite.start(
                *(name, "crane_observer", name, "--ros-args", "-p", f"machine:={run.machine}"),
                *("-p", f"model:={run.fitted}", *suite.clock),
            )
        record_to(suite, run.bag(use))
        at = pull_plug(suite, hand, run, joint, LISTENERS)
        suite.until(hand.silent, "somebody commands the valves")
        suite.stop("recorder")
        for name in reversed(OBSERVERS):
            suite.stop(name)
        stop(suite)
    return fault_answer(run.bag(use), joint, at)


class Told(NamedTuple):
    """Messages of a topic: stamps (n,) [ns], values (n, k)."""

    stamp: np.ndarray
    values: np.ndarray


def told(bag: Path, topic: Topic, values: Callable[[Any], Sequence[float]]) -> Told:
    """`values` of each message of a topic, in their order. `ProcessError` if there is none."""
    store = typestore()
    stamps, found = [], []
    with open_bag(bag) as reader:
        for block in blocks(bag, reader, [topic.name]):
            for data in block.messages:
                message: Any = store.deserialize_cdr(data, topic.msgtype)
                stamp = message.header.stamp
                stamps.append(stamp.sec * NANOSECONDS + stamp.nanosec)
                found.append(values(message))
    if not found:
        raise ProcessError(f"{bag}: nothing on {topic.name}")
    return Told(np.array(stamps, dtype=np.int64), np.array(found, dtype=float))


def fault_answer(bag: Path, joint: str, at: int) -> LostEncoder:
    """Return who named the encoder of a joint that failed `at` [ns], and when, by a recording."""
    fault = DriverState.STATE_FAULT
    names = {
        "sensor_monitor": told(bag, SENSOR_FINDINGS, lambda found: [joint in found.joint]),
        "driver": told(
            bag, DRIVER_STATE, lambda found: [found.state == fault and found.source == joint]
        ),
    }
    named = {node: _first(says, at) for node, says in names.items()}
    by = min(named, key=lambda node: named[node])
    neutral = told(bag, VALVE_OUTPUT, lambda sent: [not sent.command.any()])
    return LostEncoder(
        joint=joint,
        named_by=by,
        seconds_to_name=(named[by] - at) / NANOSECONDS,
        seconds_to_neutral=(_first(neutral, at) - at) / NANOSECONDS,
    )


def _first(of: Told, since: int) -> float:
    """When [ns] it first says so, from then on; infinite if it does not."""
    when = of.stamp[(of.stamp >= since) & (of.values[:, 0] > 0.0)]
    return float(when[0]) if when.size else math.inf
