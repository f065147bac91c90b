"""The supervisor: a clock that the test moves, and one test for each thing that may go wrong."""

import math
from itertools import pairwise

import pytest
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from crane_driver.can.frame import Fault, FaultKind
from crane_driver.safety.settings import load_safety
from crane_driver.safety.states import TRANSITIONS, Event, State
from crane_driver.safety.supervisor import Output, RefusedError, Supervisor, check_valves
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS, load_machine

MACHINE, SAFETY = load_machine(), load_safety()
CYCLE = 0.005  # s
MIDDLE = {
    joint: (MACHINE.limits[joint].position_min + MACHINE.limits[joint].position_max) / 2
    for joint in JOINTS
}
STILL = dict.fromkeys(JOINTS, 0.0)
NEUTRAL = Output(STILL, enabled=False)
CAN_FAULT = Fault(FaultKind.CHECKSUM, "Crc is 0x00", "EncoderBase", "120")


class Bench:
    def __init__(self) -> None:
        self.now = 50.0
        self.it = Supervisor(JOINTS, MACHINE, SAFETY, self.now)
        self.it.readings(MIDDLE, STILL)

    def run(self, seconds: float, command: dict[str, float] | None = None) -> list[Output]:
        """Cycles of the bus, with a command in each if there is one."""
        outputs = []
        for _ in range(math.ceil(seconds / CYCLE)):
            self.now += CYCLE
            self.it.ready(True, self.now)
            if command is not None:
                self.command(**command)
            outputs.append(self.it.output(self.now))
        return outputs

    def command(self, **values: float) -> None:
        self.it.command(list(values), list(values.values()), self.now)

    def enabled(self) -> "Bench":
        self.run(SAFETY.settling_time + 2 * CYCLE)
        self.it.enable(self.now)
        self.run(2 * CYCLE, {"slew": 0.0})
        return self

    def moving(self) -> "Bench":
        """Enabled, with the slew valve fully open."""
        assert self.enabled().run(1.0, {"slew": 1.0})[-1] == Output({**STILL, "slew": 1.0}, True)
        return self


def fell(outputs: list[Output]) -> None:
    """Assert that the slew command went to neutral by the ramp, and then the valves closed."""
    values = [one.commands["slew"] for one in outputs]
    steps = [before - after for before, after in pairwise(values)]
    assert values[0] < 1.0
    assert all(0.0 <= step <= CYCLE / SAFETY.ramp_time + 1e-9 for step in steps)
    assert values[-1] == 0.0
    assert all(one.enabled == any(one.commands.values()) for one in outputs)


def test_it_is_offline_until_the_readings_are_complete() -> None:
    one = Bench()
    one.it.ready(False, one.now + 10.0)
    assert one.it.state is State.OFFLINE
    with pytest.raises(RefusedError, match="state is offline; not all messages"):
        one.it.enable(one.now)
    one.it.readings(MIDDLE, {**STILL, "telescope": math.nan})
    one.run(1.0)
    assert one.it.state is State.OFFLINE
    one.it.readings(MIDDLE, STILL)
    one.run(CYCLE)
    assert one.it.state is State.DISABLED


def test_commands_pass_only_while_enabled() -> None:
    one = Bench()
    assert one.run(0.5, {"slew": 0.5})[-1] == NEUTRAL
    one.run(0.2)
    one.it.enable(one.now)
    one.run(CYCLE, {"slew": 0.0})
    assert one.run(CYCLE, {"slew": 0.04, "telescope": -0.03})[-1] == Output(
        {**STILL, "slew": 0.04, "telescope": -0.03}, True
    )


def test_enable_needs_a_neutral_command() -> None:
    one = Bench()
    one.run(0.5, {"slew": 0.5})
    with pytest.raises(RefusedError, match=r"the command is slew 0\.5; command neutral first"):
        one.it.enable(one.now)
    one.run(CYCLE, {"slew": 0.05})
    one.it.enable(one.now)


def test_the_first_command_after_enable_must_be_neutral() -> None:
    one = Bench()
    one.run(0.5)
    one.it.enable(one.now)
    with pytest.raises(RefusedError, match=r"first command is slew 0\.5; begin with a neutral one"):
        one.command(slew=0.5)
    assert one.run(0.3)[-1].commands == STILL
    assert one.it.state is State.ENABLED


def test_an_old_command_ramps_to_neutral_and_latches() -> None:
    one = Bench().moving()
    outputs = one.run(SAFETY.command_timeout - CYCLE)
    assert all(output.commands["slew"] == 1.0 for output in outputs)
    fell(one.run(SAFETY.ramp_time + 4 * CYCLE)[2:])
    assert one.it.state is State.FAULT
    (fault,) = one.it.faults.values()
    assert fault.text.startswith("command timeout: last command 10")
    assert "limit 100 ms, it was slew 1" in fault.text
    assert one.run(0.5, {"slew": 1.0})[-1] == NEUTRAL


def test_commands_that_end_at_neutral_leave_no_fault_but_must_begin_there_again() -> None:
    one = Bench().enabled()
    assert one.run(1.0)[-1] == Output(STILL, True)
    with pytest.raises(RefusedError, match="begin with a neutral one"):
        one.command(slew=0.5)
    one.command(slew=0.0)
    one.command(slew=0.5)
    assert one.run(CYCLE)[-1].commands["slew"] > 0.0


@pytest.mark.parametrize(
    ("names", "values", "reason"),
    [
        (["slew"], [math.nan], "valve command for slew is nan, limits -1 and 1"),
        (["slew"], [math.inf], "slew is inf"),
        (["slew", "telescope"], [0.0, -1.01], r"telescope is -1\.01"),
        (["slew", "elbow"], [0.0, 0.0], "for 'elbow', but there are valves for slew, inner_boom"),
        (["slew", "slew"], [0.0, 0.0], "names slew twice"),
        (["slew"], [], "1 names and 0 values"),
    ],
)
def test_a_wrong_command_is_refused_as_a_whole_and_named(
    names: list[str], values: list[float], reason: str
) -> None:
    one = Bench().moving()
    with pytest.raises(RefusedError, match=f"{reason}.*; the whole command is refused"):
        one.it.command(names, values, one.now)
    assert one.it.refused == 1
    assert one.run(CYCLE)[-1].commands["slew"] == 1.0  # the last good one still counts
    for _ in range(40):
        one.run(CYCLE)
        with pytest.raises(RefusedError):
            one.it.command(names, values, one.now)
    assert one.it.state is State.FAULT  # but does not become younger
    assert "command timeout" in one.it.faults


def test_two_publishers_are_refused_and_stop_the_crane() -> None:
    one = Bench().moving()
    one.it.published_by(2)
    with pytest.raises(RefusedError, match="2 publishers command the valves, one may"):
        one.command(slew=1.0)
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE))
    assert one.it.state is State.FAULT
    assert "several publishers" in one.it.faults
    one.it.reset(one.now)
    one.run(0.5)
    with pytest.raises(RefusedError, match="2 publishers command the valves; stop all but one"):
        one.it.enable(one.now)
    one.it.published_by(1)
    one.it.enable(one.now)


@pytest.mark.parametrize("kind", list(FaultKind))
def test_every_fault_of_the_bus_ramps_to_neutral_and_latches(kind: FaultKind) -> None:
    one = Bench().moving()
    fault = Fault(kind, "detail", "EncoderBase", "120")
    one.it.can_faults([fault, fault], one.now)
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE))
    (latched,) = one.it.faults.values()
    assert (latched.text, latched.count) == (f"CAN: EncoderBase (120): {kind}: detail", 2)
    assert one.run(5.0, {"slew": 0.0})[-1] == NEUTRAL
    assert one.it.state is State.FAULT  # though all is well again


def test_a_joint_without_a_known_velocity_stops_the_crane() -> None:
    one = Bench().moving()
    one.it.readings(MIDDLE, {**STILL, "outer_boom": math.nan})
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE))
    assert one.it.faults["no state"].text == "no state: no position and velocity of outer_boom"


def test_disable_ramps_to_neutral() -> None:
    one = Bench().moving()
    one.it.disable()
    with pytest.raises(RefusedError, match="valves are not neutral yet"):
        one.it.enable(one.now)
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE, {"slew": 1.0}))
    assert one.it.state is State.DISABLED
    one.it.disable()  # a second time


def test_emergency_stop_is_neutral_at_once_from_every_state() -> None:
    for one in (Bench(), Bench().enabled(), Bench().moving()):
        one.it.emergency_stop()
        assert one.run(CYCLE, {"slew": 1.0})[-1] == NEUTRAL
        assert one.it.state is State.ESTOP
        with pytest.raises(RefusedError, match="state is emergency stop"):
            one.it.enable(one.now)
        one.it.reset(one.now)
        one.run(0.5)
        assert one.it.state is State.DISABLED


def test_reset_waits_for_the_ramp_and_does_not_enable() -> None:
    one = Bench().moving()
    one.it.can_faults([CAN_FAULT], one.now)
    one.run(CYCLE)
    with pytest.raises(RefusedError, match="not reset: the valves are not neutral yet"):
        one.it.reset(one.now)
    one.run(SAFETY.ramp_time)
    one.it.reset(one.now)
    assert one.run(1.0, {"slew": 1.0})[-1] == NEUTRAL
    assert one.it.state is State.DISABLED
    assert not one.it.faults


def test_faults_that_go_on_keep_the_crane_offline_after_reset() -> None:
    one = Bench().enabled()
    one.it.can_faults([CAN_FAULT], one.now)
    one.it.reset(one.now + CYCLE)
    for _ in range(100):
        one.it.can_faults([CAN_FAULT], one.now)
        one.run(CYCLE)
    assert one.it.state is State.OFFLINE


def test_state_changes_and_faults_are_told_once() -> None:
    one = Bench().enabled()
    one.it.news.clear()
    one.it.can_faults([CAN_FAULT] * 3, one.now)
    assert one.it.news == [f"CAN: {CAN_FAULT}", "enabled -> fault"]


def test_only_enable_leads_to_enabled_and_only_reset_out_of_a_latched_state() -> None:
    for (before, event), after in TRANSITIONS.items():
        assert (after is State.ENABLED) == (event is Event.ENABLE)
        if before in (State.FAULT, State.ESTOP) and after is not State.ESTOP:
            assert (event, after) == (Event.RESET, State.OFFLINE)


def test_a_valve_without_a_position_is_refused() -> None:
    check_valves(JOINTS, JOINTS)
    with pytest.raises(ConfigurationError, match="telescope can be commanded, but there is no pos"):
        check_valves(JOINTS, JOINTS[:3])


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

    @rule(value=st.sampled_from([0.0, 0.03, 0.5, -1.0, math.nan, 2.0]))
    def send(self, value: float) -> None:
        try:
            self.bench.command(slew=value)
        except RefusedError:
            return
        assert abs(value) <= 1.0
        self.last_good = self.bench.now

    @rule(count=st.sampled_from([0, 1, 2]))
    def publishers(self, count: int) -> None:
        self.bench.it.published_by(count)

    @rule()
    def can_fault(self) -> None:
        self.bench.it.can_faults([CAN_FAULT], self.bench.now)

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
