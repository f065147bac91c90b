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
from typing import NamedTuple

import numpy as np
import yaml
from keyboard import Keyboard
from laws import OUT

from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_benchmark.rehearsal.live_node import LEADING, Say, record_to, start, stop
from crane_benchmark.rehearsal.operator_node import OperatorNode, pull_plug
from crane_benchmark.rehearsal.processes import Processes
from crane_driver import load_safety
from crane_driver.operator.jog.jog_input import JOINT_KEYS
from crane_interfaces.msg import DriverState
from crane_model import ConfigurationError, load_machine, load_model
from crane_observer.position.filter import refuse_unserved
from crane_sim import load_simulated_crane

USE = "unplugged"  # of its bag
LOAD = 60.0  # kg at the tip
OBSERVERS = ("position_estimator", "sensor_monitor", "payload_estimator")
LISTENERS = (*LEADING, *OBSERVERS)
HOME = {"rad": 0.02, "m": 0.01}  # from the rest pose
RETRY_S = 1.0
PLUGGED_IN_S = 1.0  # recorded afterwards


class Pulled(NamedTuple):
    """Which encoder, when [ns], and when the crane was home."""

    joint: str
    at: int
    home: int


def joint_to_lose(law: CraneRun) -> str:
    """The last joint that turns of those whose encoder may be replaced; empty if there is none."""
    machine = load_machine(law.machine)
    degraded = load_safety(law.file("safety.yaml"), machine).degraded
    permitted = degraded.deviation if degraded else {}
    known = load_model(law.fitted).joints
    turning = [j for j in known if j in permitted and machine.units[j] == "rad"]
    return turning[-1] if turning else ""


def refusal(law: CraneRun) -> str:
    """Return why the crane cannot go home without an encoder; empty if it can."""
    if not (joint := joint_to_lose(law)):
        return "safety.yaml permits no substitute"
    model = load_model(law.fitted)
    try:
        refuse_unserved(model, np.isin(model.joints, joint))
    except ConfigurationError as error:
        return str(error)
    return ""


def unplug(suite: Processes, domain: int, law: CraneRun, seed: int, joint: str, say: Say) -> Pulled:
    """Recorded as the bag `USE`. `ProcessError` where a process fails or nothing is noticed."""
    say(f"an encoder ({joint}) is unplugged in motion, under an undeclared load of {LOAD:g} kg")
    with OperatorNode(suite, domain) as hand:
        known = ("-p", f"model:={law.fitted}", *suite.clock)
        led = ("-p", f"law:={law.controller}", "-p", f"model:={law.fitted}")
        start(suite, law, seed, *led, listeners=LISTENERS, plant=_loaded(law))
        for name in OBSERVERS:
            of_machine = ("--ros-args", "-p", f"machine:={law.machine}", *known)
            suite.start(name, "crane_observer", name, *of_machine)
        record_to(suite, law.bag(USE))
        at = pull_plug(suite, hand, law, joint, LISTENERS)
        say("the crane has stopped; jog moves it home on the estimate")
        suite.until(lambda: hand.substitute(joint), "the driver takes no substitute")
        suite.until(hand.reset, "the fault is not reset")
        suite.until(hand.silent, "somebody commands the valves")
        with Keyboard(suite, law.machine, hand.clock.now) as keys:
            _go_home(suite, hand, keys, law)
            home = hand.now
            suite.until(lambda: _disabled(hand, keys), "the driver is not disabled")
        suite.tell("crane", repaired := f"repaired={joint}.encoder")
        told = repaired.replace("=", ": ")
        suite.until(lambda: told in suite.said("crane"), "the encoder is not repaired")
        suite.until(lambda: hand.substitute(""), "the encoder is not taken back")
        suite.until(lambda: hand.reads(joint), "no reading of the encoder comes")
        end = time.monotonic() + PLUGGED_IN_S
        suite.until(lambda: time.monotonic() > end, "")
        suite.stop("recorder")
        for name in reversed(OBSERVERS):
            suite.stop(name)
        stop(suite)
    return Pulled(joint, at, home)


def _go_home(suite: Processes, hand: OperatorNode, keys: Keyboard, law: CraneRun) -> None:
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


def _there(hand: OperatorNode, joint: str, goal: float, upwards: bool) -> bool:
    """Whether the joint is beyond its goal, or the driver lets nothing through."""
    beyond = (hand.position(joint) > goal) == upwards
    return beyond or not hand.in_state(DriverState.STATE_DEGRADED)


def _enable(suite: Processes, hand: OperatorNode, keys: Keyboard) -> None:
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


def _disabled(hand: OperatorNode, keys: Keyboard) -> bool:
    keys.press("d")
    return hand.in_state(DriverState.STATE_DISABLED)


def _loaded(law: CraneRun) -> Path:
    """A simulated-crane file with a load in the outermost body."""
    simulated = yaml.safe_load(law.plant.read_text(encoding="utf-8"))
    outermost = list(simulated["bodies"])[-1]
    simulated["bodies"][outermost]["mass"] += LOAD
    path = OUT / "loaded.yaml"
    path.write_text(yaml.safe_dump(simulated), encoding="utf-8")
    return path
