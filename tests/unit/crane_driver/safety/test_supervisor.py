"""The supervisor: one test for each thing that may go wrong."""

import math
from contextlib import suppress
from itertools import pairwise

import pytest
from unit.crane_driver.safety.supervised import (
    CAN_FAULT,
    CYCLE,
    MIDDLE,
    NEUTRAL,
    SAFETY,
    STILL,
    Bench,
)

from crane_driver import Fault, FaultKind
from crane_driver.safety.commands import RefusedError, check_valves
from crane_driver.safety.supervisor import TRANSITIONS, Event, Level, LogEntry, Output, SafetyState
from crane_model import ConfigurationError, load_machine

JOINTS = load_machine().joint_names


def fell(outputs: list[Output]) -> None:
    """Assert that the slew command went to neutral by the ramp, and then the valves closed."""
    values = [one.commands["slew"] for one in outputs]
    steps = [before - after for before, after in pairwise(values)]
    assert values[0] < 1.0
    assert all(0.0 <= step <= CYCLE / SAFETY.ramp_time + 1e-9 for step in steps)
    assert values[-1] == 0.0
    assert all(one.enabled == any(one.commands.values()) for one in outputs)


def test_a_valve_that_is_enabled_anew_opens_from_neutral() -> None:
    """Neutral and the next command may come between two outputs, so that no output is neutral."""
    bench = Bench().moving()
    bench.it.disable()
    bench.run(SAFETY.ramp_time + CYCLE)
    bench.it.enable(bench.now)
    bench.command(slew=0.0)
    bench.command(slew=1.0)
    (output,) = bench.run(CYCLE)
    assert 0.0 < output.commands["slew"] <= SAFETY.opening + CYCLE / SAFETY.opening_time + 1e-9


def test_it_is_offline_until_the_readings_are_complete() -> None:
    one = Bench()
    one.it.ready(False, one.now + 10.0)
    assert one.it.state is SafetyState.OFFLINE
    with pytest.raises(RefusedError, match="state is offline; not all messages"):
        one.it.enable(one.now)
    one.it.readings(MIDDLE, {**STILL, "telescope": math.nan})
    one.run(1.0)
    assert one.it.state is SafetyState.OFFLINE
    one.it.readings(MIDDLE, STILL)
    one.run(CYCLE)
    assert one.it.state is SafetyState.DISABLED


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


def test_a_driver_that_is_enabled_needs_no_remedy() -> None:
    one = Bench().enabled()
    with pytest.raises(RefusedError, match="^not enabled: the state is enabled$"):
        one.it.enable(one.now)


def test_the_first_command_after_enable_must_be_neutral() -> None:
    one = Bench()
    one.run(0.5)
    one.it.enable(one.now)
    with pytest.raises(RefusedError, match=r"first command is slew 0\.5; begin with a neutral one"):
        one.command(slew=0.5)
    assert one.run(0.3)[-1].commands == STILL
    assert one.it.state is SafetyState.ENABLED


def test_an_old_command_ramps_to_neutral_and_latches() -> None:
    one = Bench().moving()
    outputs = one.run(SAFETY.command_timeout - CYCLE)
    assert all(output.commands["slew"] == 1.0 for output in outputs)
    fell(one.run(SAFETY.ramp_time + 4 * CYCLE)[2:])
    assert one.it.state is SafetyState.FAULT
    (fault,) = one.it.faults.values()
    text = str(fault.fault)
    assert text.startswith("command timeout: last command 10")
    assert "limit 100 ms, it was slew 1" in text
    assert one.run(0.5, {"slew": 1.0})[-1] == NEUTRAL


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_command_that_comes_too_late_does_not_hide_that_none_came(late: float) -> None:
    """Between two cycles, before anybody has looked how old the last one is."""
    one = Bench().moving()
    one.now += SAFETY.command_timeout + 1e-3
    with suppress(RefusedError):
        one.command(slew=late)
    outputs = one.run(SAFETY.ramp_time + 2 * CYCLE)
    assert one.it.state is SafetyState.FAULT
    assert "command timeout" in one.it.faults
    fell(outputs)


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
    assert one.it.commands.refused == 1
    assert one.run(CYCLE)[-1].commands["slew"] == 1.0  # the last good one still counts
    for _ in range(40):
        one.run(CYCLE)
        with pytest.raises(RefusedError):
            one.it.command(names, values, one.now)
    assert one.it.state is SafetyState.FAULT  # but does not become younger
    assert "command timeout" in one.it.faults


def test_two_publishers_are_refused_and_stop_the_crane() -> None:
    one = Bench().moving()
    one.it.published_by(2)
    with pytest.raises(RefusedError, match="2 publishers command the valves, one may"):
        one.command(slew=1.0)
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE))
    assert one.it.state is SafetyState.FAULT
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
    assert (latched.fault, latched.count) == (fault, 2)
    assert one.run(5.0, {"slew": 0.0})[-1] == NEUTRAL
    assert one.it.state is SafetyState.FAULT  # though all is well again


def test_a_joint_without_a_known_velocity_stops_the_crane() -> None:
    one = Bench().moving()
    one.it.readings(MIDDLE, {**STILL, "outer_boom": math.nan})
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE))
    assert one.it.faults["no state"].fault.detail == "no position and velocity of outer_boom"


def test_disable_ramps_to_neutral() -> None:
    one = Bench().moving()
    one.it.disable()
    with pytest.raises(RefusedError, match="valves are not neutral yet"):
        one.it.enable(one.now)
    fell(one.run(SAFETY.ramp_time + 2 * CYCLE, {"slew": 1.0}))
    assert one.it.state is SafetyState.DISABLED
    one.it.disable()  # a second time


def test_emergency_stop_is_neutral_at_once_from_every_state() -> None:
    for one in (Bench(), Bench().enabled(), Bench().moving()):
        one.it.emergency_stop()
        assert one.run(CYCLE, {"slew": 1.0})[-1] == NEUTRAL
        assert one.it.state is SafetyState.ESTOP
        with pytest.raises(RefusedError, match="state is emergency stop"):
            one.it.enable(one.now)
        one.it.reset(one.now)
        one.run(0.5)
        assert one.it.state is SafetyState.DISABLED


def test_reset_waits_for_the_ramp_and_does_not_enable() -> None:
    one = Bench().moving()
    one.it.can_faults([CAN_FAULT], one.now)
    one.run(CYCLE)
    with pytest.raises(RefusedError, match="not reset: the valves are not neutral yet"):
        one.it.reset(one.now)
    one.run(SAFETY.ramp_time)
    one.it.reset(one.now)
    assert one.run(1.0, {"slew": 1.0})[-1] == NEUTRAL
    assert one.it.state is SafetyState.DISABLED
    assert not one.it.faults


def test_faults_that_go_on_keep_the_crane_offline_after_reset() -> None:
    one = Bench().enabled()
    one.it.can_faults([CAN_FAULT], one.now)
    one.it.reset(one.now + CYCLE)
    for _ in range(100):
        one.it.can_faults([CAN_FAULT], one.now)
        one.run(CYCLE)
    assert one.it.state is SafetyState.OFFLINE


def test_state_changes_and_faults_are_told_once() -> None:
    one = Bench().enabled()
    one.it.log.clear()
    one.it.can_faults([CAN_FAULT] * 3, one.now)
    assert one.it.log == [
        LogEntry(
            Level.ERROR,
            "encoder of slew, EncoderBase (120): checksum: Crc is 0x00: valves neutral; check "
            "wiring and termination, and the CRC in the mapping, then call reset_fault",
        )
    ]
    one.it.log.clear()
    one.run(SAFETY.ramp_time)
    one.it.reset(one.now)
    one.run(SAFETY.settling_time + 2 * CYCLE)
    offline, disabled = "fault -> offline", "offline -> disabled"
    assert one.it.log == [LogEntry(Level.INFO, offline), LogEntry(Level.INFO, disabled)]


def test_what_follows_from_a_fault_is_counted_and_not_told_again() -> None:
    """A bus that goes away makes every message late, then missing."""
    one = Bench().enabled()
    one.it.log.clear()
    late = [Fault(FaultKind.LATE, "51 ms", f"Message{k}", "120") for k in range(20)]
    one.it.can_faults(late, one.now)
    one.it.readings(MIDDLE, {**STILL, "outer_boom": math.nan})
    levels = [news.level for news in one.it.log]
    assert levels == [Level.ERROR] + 19 * [Level.DEBUG]
    assert one.it.faults.first is late[0]
    assert one.it.cause == "Message0 (120): late: 51 ms"
    with pytest.raises(RefusedError) as refused:
        one.it.enable(one.now)
    assert len(str(refused.value)) < 200
    assert "Message0 (120): late" in str(refused.value)
    assert str(refused.value).endswith("then call reset_fault")


def test_a_foreign_command_is_told_whatever_else_is_wrong() -> None:
    one = Bench().enabled()
    one.it.can_faults([CAN_FAULT], one.now)
    one.it.log.clear()
    foreign = Fault(FaultKind.FOREIGN, "another node commands the valves", "ValveCommand", "110")
    one.it.can_faults([foreign], one.now)
    assert [news.level for news in one.it.log] == [Level.ERROR]
    assert one.it.faults.first is foreign
    assert one.it.cause == str(foreign)
    assert "off the bus" in one.it.remedy


def test_only_enable_leads_to_enabled_and_only_reset_out_of_a_latched_state() -> None:
    for (before, event), after in TRANSITIONS.items():
        assert (after is SafetyState.ENABLED) == (event is Event.ENABLE)
        if before in (SafetyState.FAULT, SafetyState.ESTOP) and after is not SafetyState.ESTOP:
            assert (event, after) == (Event.RESET, SafetyState.OFFLINE)


def test_a_valve_without_a_position_is_refused() -> None:
    check_valves(JOINTS, JOINTS)
    with pytest.raises(ConfigurationError, match="telescope can be commanded, but there is no pos"):
        check_valves(JOINTS, JOINTS[:3])
