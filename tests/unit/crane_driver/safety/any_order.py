"""Whatever may happen to a supervisor, in any order, and the rules that its output keeps."""

import math
import random
from collections import Counter

from unit.crane_driver.safety.supervised import (
    CAN_FAULT,
    CYCLE,
    MACHINE,
    MIDDLE,
    NEUTRAL,
    SAFETY,
    Bench,
)

from crane_driver import Fault, FaultKind
from crane_driver.safety.commands import RefusedError
from crane_driver.safety.plausibility import JointEstimate
from crane_driver.safety.supervisor import LETTING_THROUGH, SafetyState

WAITS = (0.005, 0.05, 0.3)  # s
REPEATED = (None, 0.0, 0.5, -1.0)  # commands in each cycle of a wait
COMMANDS = (0.0, 0.03, 0.5, 1.0, -1.0, math.nan, 2.0)
BEYOND = 0.02  # of the range of a joint, at both ends
SPEEDS = (0.0, 0.1, -0.1, 0.5, -0.5)  # rad/s
PUBLISHERS = (0, 1, 2)
REQUESTS = ("enable", "enable", "disable", "stop", "reset", "substitute", "believe")
DEVIATIONS = (0.005, 0.03, 0.1, math.nan)  # rad, of an estimate
SUBSTITUTED = "inner_boom"
# How often each comes in a long run: now and then nothing is wrong for long enough to move.
OFTEN = {
    "wait": 30,
    "send": 5,
    "measured": 4,
    "ask": 12,
    "publishers": 0.3,
    "can_fault": 0.3,
    "stall": 0.1,
    "estimated": 20,
}
STALL = Fault(FaultKind.STALLED, "for 60 ms")
ASKED = {"enable": 10, "reset": 10, "disable": 1, "stop": 0.5, "substitute": 2, "believe": 0.5}


class Happening:
    """A supervisor, and events that happen to it; each asserts the rules."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.before = 0.0
        self.last_good = -math.inf
        self.events = 0  # calls of the supervisor
        self.cycles: Counter[SafetyState] = Counter()
        self.moving = 0  # cycles with an open valve
        self.bench.run(0.3)

    def anything(self, rng: random.Random) -> None:
        """One random event."""
        (event,) = rng.choices(list(OFTEN), list(OFTEN.values()))
        match event:
            case "wait":
                self.wait(rng.choice(WAITS), rng.choice(REPEATED))
            case "send":
                self.send(rng.choice(COMMANDS))
            case "measured":
                self.measured(rng.uniform(-BEYOND, 1.0 + BEYOND), rng.choice(SPEEDS))
            case "ask":
                self.ask(*rng.choices(list(ASKED), list(ASKED.values())))
            case "publishers":
                self.publishers(rng.choice(PUBLISHERS))
            case "can_fault":
                self.can_fault()
            case "stall":
                self.stall()
            case "estimated":
                self.estimated(rng.choice(DEVIATIONS))
        self.check()

    def wait(self, seconds: float, command: float | None) -> None:
        for _ in range(round(seconds / CYCLE)):
            if command is not None:
                self.send(command)
            self._cycle()

    def send(self, value: float) -> None:
        self.events += 1
        try:
            self.bench.command(slew=value)
        except RefusedError:
            return
        assert abs(value) <= 1.0
        self.last_good = self.bench.now

    def measured(self, at: float, speed: float) -> None:
        """`at`: from one limit of the slew (0) to the other (1), and a little beyond."""
        self.events += 1
        limits = MACHINE.limits["slew"]
        width = limits.position_max - limits.position_min
        self.bench.slew(limits.position_min + at * width, speed)

    def publishers(self, count: int) -> None:
        self.events += 1
        self.bench.it.published_by(count)

    def can_fault(self) -> None:
        self.events += 1
        self.bench.it.can_faults([CAN_FAULT], self.bench.now)

    def stall(self) -> None:
        self.events += 1
        self.bench.it.stalled(STALL, self.bench.now)

    def estimated(self, deviation: float) -> None:
        """Of a joint in the middle of its range."""
        self.events += 1
        now = self.bench.now
        estimate = JointEstimate(now, MIDDLE[SUBSTITUTED], 0.0, deviation, "GOOD")
        self.bench.it.estimated(estimate, now)

    def ask(self, request: str) -> None:
        self.events += 1
        it, now = self.bench.it, self.bench.now
        before = it.state
        try:
            match request:
                case "enable":
                    it.enable(now)
                case "disable":
                    it.disable()
                case "stop":
                    it.emergency_stop()
                    self.before = 0.0
                case "reset":
                    it.reset(now)
                case "substitute":
                    it.substitute(SUBSTITUTED)
                case "believe":
                    it.substitute("")
        except RefusedError:
            assert it.state is before

    def check(self) -> None:
        """Latched faults forbid motion."""
        if self.bench.it.faults:
            assert self.bench.it.state not in (*LETTING_THROUGH, SafetyState.DISABLED)
        assert self.bench.it.state is not SafetyState.ENABLED or not self.bench.it.substituted
        assert self.bench.it.state is not SafetyState.DEGRADED or self.bench.it.substituted

    def _cycle(self) -> None:
        self.events += 1
        (output,) = self.bench.run(CYCLE)
        value, state = output.commands["slew"], self.bench.it.state
        self.cycles[state] += 1
        self.moving += value != 0.0
        if state not in LETTING_THROUGH:
            assert abs(value) <= max(0.0, abs(self.before) - CYCLE / SAFETY.ramp_time) + 1e-9
            assert output.enabled == (value != 0.0)
        going_on = abs(self.before) if value * self.before > 0.0 else 0.0
        opened = max(going_on, SAFETY.opening) + CYCLE / SAFETY.opening_time
        assert abs(value) <= opened + 1e-9
        if self.bench.now - self.last_good > SAFETY.command_timeout + CYCLE:
            assert abs(value) <= abs(self.before)
        if state in (SafetyState.ESTOP, SafetyState.OFFLINE):
            assert output == NEUTRAL
        self.before = value
        self.bench.it.log.clear()
