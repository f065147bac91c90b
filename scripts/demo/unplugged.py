"""An encoder is unplugged in mid-motion: named, the crane at rest, then home without it.

The simulated crane freezes the encoder while its counters go on: the bus alone shows nothing.
`sensor_monitor` or the driver names it, whichever is quicker. Then the driver moves that joint by
`position_estimator`, degraded, and an operator at the keys of `jog` controls the crane to its rest
pose while `payload_estimator` estimates a load that the model does not know.
"""

import math
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import live
import yaml
from following import CONTROLLER
from keyboard import Keyboard
from laws import OUT, VALIDATION, Law
from live import Onlooker, Say
from processes import Processes
from rclpy.action import ActionClient
from rclpy.task import Future
from sensor_msgs.msg import JointState

from crane_driver.operator.jog.jog_input import JOINT_KEYS
from crane_driver.safety.commands import load_safety
from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import DriverState, PositionEstimate, SensorFindings
from crane_interfaces.srv import SubstituteEncoder
from crane_model.machine import load_machine
from crane_model.model_file import load_model
from crane_nodes.driver_client import LATCHED
from crane_nodes.node_time import nanoseconds
from crane_sim.parts.parameters import load_simulated_crane

USE = "unplugged"  # of its bag
LOAD = 60.0  # kg at the tip
OBSERVERS = ("position_estimator", "sensor_monitor", "payload_estimator")
LISTENERS = (*live.LEADING, *OBSERVERS)
KNOWN = 3.0  # s of motion, before the plug is pulled
FAST = 0.5  # of the joint's largest speed until then, at which it is pulled
MOVES = 0.02  # rad/s
HOME = {"rad": 0.02, "m": 0.01}  # from the rest pose
AGREES = 0.05  # rad, between a repaired encoder and the estimate
RETRY_S = 1.0
LOOK_S = 0.02  # at most, for something that comes
PLUGGED_IN_S = 1.0  # recorded afterwards


class Pulled(NamedTuple):
    """Which encoder, when [ns], and when the crane was home."""

    joint: str
    at: int
    home: int


class Hand(Onlooker):
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
        """Whether the driver is in a fault, and this joint's encoder was named."""
        self._look()
        state = self.driver.state
        named = joint in self.named or state.source == joint
        return named and state.state == DriverState.STATE_FAULT

    def in_state(self, *states: int) -> bool:
        """Whether the driver is in one of these."""
        self._look()
        return self.driver.state.state in states

    def silent(self) -> bool:
        """Whether nobody commands the valves."""
        self._look()
        return self.node.count_publishers("valve_command") == 0

    def over(self) -> bool:
        """Whether the experiment that was begun has ended."""
        self._look()
        return bool(self._ending and self._ending.done())

    def begin(self, trajectory: str) -> bool:
        """Enable, and one period of a trajectory; whether both were accepted.

        By this node, which the others know by now.
        """
        enabled = self._answer(self.driver.enable())
        if not (enabled and enabled.success):
            return False
        goal = RunExcitation.Goal(trajectory=trajectory, periods=1)
        handle = self._answer(self._action.send_goal_async(goal))
        if not (handle and handle.accepted):
            return False
        self._ending = handle.get_result_async()
        return True

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
        self.executor.spin_until_future_complete(future, timeout_sec=live.ANSWER_TIMEOUT_S)
        return future.result()

    def _measured(self, message: JointState) -> None:
        self.states = message

    def _estimated(self, message: PositionEstimate) -> None:
        self.estimate = message

    def _found(self, message: SensorFindings) -> None:
        self.named = tuple(message.joint)


def joint_to_lose(law: Law) -> str:
    """The last joint that turns of those whose encoder may be replaced; empty if there is none."""
    machine = load_machine(law.machine)
    degraded = load_safety(law.file("safety.yaml"), machine).degraded
    permitted = degraded.deviation if degraded else {}
    known = load_model(law.fitted).joints
    turning = [j for j in known if j in permitted and machine.units[j] == "rad"]
    return turning[-1] if turning else ""


def unplug(suite: Processes, domain: int, law: Law, seed: int, joint: str, say: Say) -> Pulled:
    """Recorded as the bag `USE`. `DemoError` where a process fails or nothing is noticed."""
    say(f"an encoder is unplugged in mid-motion: {joint}; {LOAD:g} kg hang at the tip, untold")
    with Hand(suite, domain) as hand:
        known = ("-p", f"model:={law.fitted}", *suite.clock)
        led = ("-p", f"law:={CONTROLLER}", "-p", f"model:={law.fitted}")
        live.start(suite, law, seed, *led, listeners=LISTENERS, plant=_loaded(law))
        for name in OBSERVERS:
            of_machine = ("--ros-args", "-p", f"machine:={law.machine}", *known)
            suite.start(name, "crane_observer", name, *of_machine)
        live.record_to(suite, law.bag(USE))
        at = _pull(suite, hand, law, joint)
        say("named, and at rest; home by the estimate, at the keys of jog")
        suite.until(lambda: hand.substitute(joint), "the driver takes no substitute")
        suite.until(hand.reset, "the fault is not reset")
        suite.until(hand.silent, "somebody commands the valves")
        with Keyboard(suite, law.machine, hand.clock.now) as keys:
            _go_home(suite, hand, keys, law)
            home = hand.now
            suite.until(lambda: _disabled(hand, keys), "the driver is not disabled")
        suite.tell("crane", mended := f"mended={joint}.encoder")
        told = mended.replace("=", ": ")
        suite.until(lambda: told in suite.said("crane"), "the encoder is not mended")
        suite.until(lambda: hand.substitute(""), "the encoder is not taken back")
        suite.until(lambda: hand.reads(joint), "no reading of the encoder comes")
        end = time.monotonic() + PLUGGED_IN_S
        suite.until(lambda: time.monotonic() > end, "")
        suite.stop("recorder")
        for name in reversed(OBSERVERS):
            suite.stop(name)
        live.stop(suite)
    return Pulled(joint, at, home)


def _pull(suite: Processes, hand: Hand, law: Law, joint: str) -> int:
    """The plug, once the joint moves well; when [ns]."""
    hand.ready(LISTENERS)
    if not (hand.begin(str(law.file(VALIDATION).resolve())) and _moves_well(suite, hand, joint)):
        raise suite.failed("the experiment ended early", "trajectory")
    suite.tell("crane", f"fault={joint}.encoder.stuck")
    at = hand.now
    suite.until(lambda: hand.stopped_by(joint), "nobody notices")
    suite.until(hand.over, "the experiment goes on")
    return at


def _moves_well(suite: Processes, hand: Hand, joint: str) -> bool:
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


def _go_home(suite: Processes, hand: Hand, keys: Keyboard, law: Law) -> None:
    """Joint by joint, from the tip to the base; enabled again where the computer was too busy."""
    machine = load_machine(law.machine)
    rest = dict(
        zip(machine.joint_names, load_simulated_crane(law.plant).start.tolist(), strict=True)
    )
    pairs = dict(zip(machine.joint_names, JOINT_KEYS, strict=False))
    for joint in reversed(load_model(law.fitted).joints):
        near = HOME[machine.units[joint]]
        while abs(way := rest[joint] - hand.position(joint)) > near:
            _enable(suite, hand, keys)
            goal = rest[joint] - math.copysign(0.5 * near, way)
            keys.hold(pairs[joint][way > 0.0], partial(_there, hand, joint, goal, way > 0.0))


def _there(hand: Hand, joint: str, goal: float, upwards: bool) -> bool:
    """Whether the joint is beyond its goal, or the driver lets nothing through."""
    beyond = (hand.position(joint) > goal) == upwards
    return beyond or not hand.in_state(DriverState.STATE_DEGRADED)


def _enable(suite: Processes, hand: Hand, keys: Keyboard) -> None:
    """Pressed again until it is: what a busy computer made a fault has to be reset first."""
    pressed = -RETRY_S

    def enabled() -> bool:
        nonlocal pressed
        if hand.in_state(DriverState.STATE_DEGRADED):
            return True
        if time.monotonic() - pressed > RETRY_S:
            pressed = time.monotonic()
            keys.press("r" if hand.in_state(DriverState.STATE_FAULT) else "e")
        return False

    suite.until(enabled, "the driver does not let commands through")


def _disabled(hand: Hand, keys: Keyboard) -> bool:
    keys.press("d")
    return hand.in_state(DriverState.STATE_DISABLED)


def _loaded(law: Law) -> Path:
    """A simulated-crane file with a load in the outermost body."""
    simulated = yaml.safe_load(law.plant.read_text(encoding="utf-8"))
    outermost = list(simulated["bodies"])[-1]
    simulated["bodies"][outermost]["mass"] += LOAD
    path = OUT / "loaded.yaml"
    path.write_text(yaml.safe_dump(simulated), encoding="utf-8")
    return path
