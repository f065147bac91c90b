"""The supervisor: requests, commands and faults in any order."""

import math

from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from unit.crane_driver.safety.supervised import CAN_FAULT, CYCLE, MACHINE, NEUTRAL, SAFETY, Bench

from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.states import State
from crane_driver.safety.supervisor import RefusedError


class AnyOrder(RuleBasedStateMachine):
    """Whatever happens in whatever order, the rules of the output hold."""

    @initialize()
    def start(self) -> None:
        self.bench = Bench()
        self.before = 0.0
        self.last_good = -math.inf
        self.bench.run(0.3)

    @rule(seconds=st.sampled_from([0.005, 0.05, 0.3]), send=st.booleans())
    def wait(self, seconds: float, send: bool) -> None:
        for _ in range(round(seconds / CYCLE)):
            if send:
                self.send(0.0)
            self._cycle()

    @rule(value=st.sampled_from([0.0, 0.03, 0.5, 1.0, -1.0, math.nan, 2.0]))
    def send(self, value: float) -> None:
        try:
            self.bench.command(slew=value)
        except RefusedError:
            return
        assert abs(value) <= 1.0
        self.last_good = self.bench.now

    @rule(at=st.floats(-0.02, 1.02), speed=st.sampled_from([0.0, 0.1, -0.1, 0.5, -0.5]))
    def measured(self, at: float, speed: float) -> None:
        """`at`: from one limit of the slew (0) to the other (1), and a little beyond."""
        limits = MACHINE.limits["slew"]
        width = limits.position_max - limits.position_min
        self.bench.slew(limits.position_min + at * width, speed)

    @rule(count=st.sampled_from([0, 1, 2]))
    def publishers(self, count: int) -> None:
        self.bench.it.published_by(count)

    @rule()
    def can_fault(self) -> None:
        self.bench.it.can_faults([CAN_FAULT], self.bench.now)

    @rule()
    def stall(self) -> None:
        self.bench.it.stalled(Fault(FaultKind.STALLED, "for 60 ms"), self.bench.now)

    @rule(request=st.sampled_from(["enable", "enable", "disable", "stop", "reset"]))
    def ask(self, request: str) -> None:
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
        except RefusedError:
            assert it.state is before

    def _cycle(self) -> None:
        (output,) = self.bench.run(CYCLE)
        value, state = output.commands["slew"], self.bench.it.state
        if state is not State.ENABLED:
            assert abs(value) <= max(0.0, abs(self.before) - CYCLE / SAFETY.ramp_time) + 1e-9
            assert output.enabled == (value != 0.0)
        going_on = abs(self.before) if value * self.before > 0.0 else 0.0
        opened = max(going_on, SAFETY.opening) + CYCLE / SAFETY.opening_time
        assert abs(value) <= opened + 1e-9
        if self.bench.now - self.last_good > SAFETY.command_timeout + CYCLE:
            assert abs(value) <= abs(self.before)
        if state in (State.ESTOP, State.OFFLINE):
            assert output == NEUTRAL
        self.before = value

    @invariant()
    def latched_faults_forbid_motion(self) -> None:
        if hasattr(self, "bench") and self.bench.it.faults:
            assert self.bench.it.state not in (State.ENABLED, State.DISABLED)


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = hypothesis_settings(max_examples=30, stateful_step_count=25, deadline=None)
