"""The supervisor: requests, commands and faults in any order."""

import random

from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from unit.crane_driver.safety.any_order import (
    BEYOND,
    COMMANDS,
    DEVIATIONS,
    PUBLISHERS,
    REPEATED,
    REQUESTS,
    SPEEDS,
    WAITS,
    Happening,
)

from crane_driver.safety.supervisor import SafetyState


class AnyOrder(RuleBasedStateMachine):
    """Whatever happens in whatever order, the rules of the output hold."""

    @initialize()
    def start(self) -> None:
        self.it = Happening()

    @rule(seconds=st.sampled_from(WAITS), command=st.sampled_from(REPEATED))
    def wait(self, seconds: float, command: float | None) -> None:
        self.it.wait(seconds, command)

    @rule(value=st.sampled_from(COMMANDS))
    def send(self, value: float) -> None:
        self.it.send(value)

    @rule(at=st.floats(-BEYOND, 1.0 + BEYOND), speed=st.sampled_from(SPEEDS))
    def measured(self, at: float, speed: float) -> None:
        self.it.measured(at, speed)

    @rule(count=st.sampled_from(PUBLISHERS))
    def publishers(self, count: int) -> None:
        self.it.publishers(count)

    @rule()
    def can_fault(self) -> None:
        self.it.can_fault()

    @rule()
    def stall(self) -> None:
        self.it.stall()

    @rule(deviation=st.sampled_from(DEVIATIONS))
    def estimated(self, deviation: float) -> None:
        self.it.estimated(deviation)

    @rule(request=st.sampled_from(REQUESTS))
    def ask(self, request: str) -> None:
        self.it.ask(request)

    @invariant()
    def latched_faults_forbid_motion(self) -> None:
        if hasattr(self, "it"):
            self.it.check()


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = hypothesis_settings(max_examples=30, stateful_step_count=25, deadline=None)


def test_random_events_move_the_valves_too() -> None:
    happening, rng = Happening(), random.Random(1)
    while happening.events < 20_000:
        happening.anything(rng)
    assert happening.cycles.keys() == set(SafetyState) - {SafetyState.LISTENING}
    assert happening.moving > 100
