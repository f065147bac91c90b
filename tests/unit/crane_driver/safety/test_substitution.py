"""One joint without encoder: what starts degraded operation, what it allows, what ends it."""

import math
from pathlib import Path

import pytest
from unit.crane_driver.safety.supervised import (
    CAN_FAULT,
    CYCLE,
    MACHINE,
    MIDDLE,
    SAFETY,
    STILL,
    Bench,
)

from crane_driver import Fault, FaultKind, constants, load_safety
from crane_driver.safety.commands import RefusedError
from crane_driver.safety.plausibility import JointEstimate
from crane_driver.safety.supervisor import SafetyState
from crane_model import ConfigurationError
from crane_model.machine_files import machine_file

SUBSTITUTED = "inner_boom"
WITHOUT = {**MIDDLE, SUBSTITUTED: math.nan}
SURE = 0.01  # rad
DEGRADED = SAFETY.degraded
assert DEGRADED is not None


def told(
    bench: Bench,
    seconds: float = CYCLE,
    command: dict[str, float] | None = None,
    position: float = MIDDLE[SUBSTITUTED],
    velocity: float = 0.0,
    deviation: float = SURE,
    condition: str = "GOOD",
) -> float:
    """Cycles with an estimate in each; what its valve is sent at last."""
    for _ in range(math.ceil(seconds / CYCLE)):
        bench.it.readings(WITHOUT, {**STILL, SUBSTITUTED: math.nan})
        estimate = JointEstimate(bench.now, position, velocity, deviation, condition)
        bench.it.estimated(estimate, bench.now)
        (output,) = bench.run(CYCLE, command)
    return output.commands[SUBSTITUTED]


def degraded(bench: Bench) -> Bench:
    bench.it.substitute(SUBSTITUTED)
    told(bench, SAFETY.settling_time + 2 * CYCLE)
    bench.it.enable(bench.now)
    told(bench, 2 * CYCLE, {SUBSTITUTED: 0.0})
    return bench


def state_of(bench: Bench) -> SafetyState:
    """Of now: a checker must not take it for that of before."""
    return bench.it.state


def fault_of(bench: Bench) -> Fault:
    assert state_of(bench) is SafetyState.FAULT
    assert bench.it.faults.first is not None
    return bench.it.faults.first


def test_a_lost_encoder_needs_a_substitute_that_is_told() -> None:
    bench = Bench()
    bench.it.readings(WITHOUT, {**STILL, SUBSTITUTED: math.nan})
    bench.run(1.0)
    assert state_of(bench) is SafetyState.OFFLINE
    bench.it.substitute(SUBSTITUTED)
    bench.run(1.0)
    assert state_of(bench) is SafetyState.OFFLINE
    assert f"{SUBSTITUTED}: no estimate of its position has arrived" in bench.it.cause
    told(bench, 1.0)
    assert state_of(bench) is SafetyState.DISABLED
    bench.it.enable(bench.now)
    assert state_of(bench) is SafetyState.DEGRADED


def test_a_substitute_clears_no_fault_and_enables_nothing() -> None:
    bench = Bench().enabled()
    bench.it.can_faults([CAN_FAULT], bench.now)
    bench.run(0.5)
    bench.it.substitute(SUBSTITUTED)
    assert fault_of(bench) is CAN_FAULT
    bench.it.reset(bench.now)
    told(bench, 1.0)
    assert state_of(bench) is SafetyState.DISABLED


def test_a_substitute_is_refused_while_the_crane_moves() -> None:
    for bench in (Bench().moving(), degraded(Bench())):
        before = bench.it.substituted
        for joint in (SUBSTITUTED, ""):
            with pytest.raises(RefusedError, match="disable first"):
                bench.it.substitute(joint)
        assert bench.it.substituted == before
    bench = Bench().moving()
    bench.it.disable()
    bench.run(CYCLE)
    with pytest.raises(RefusedError, match="disable first"):  # the ramp runs
        bench.it.substitute(SUBSTITUTED)


def test_a_second_substitute_and_one_that_the_settings_lack_are_refused() -> None:
    bench = Bench()
    bench.it.substitute(SUBSTITUTED)
    with pytest.raises(RefusedError, match=f"{SUBSTITUTED} has one already"):
        bench.it.substitute("outer_boom")
    bench.it.substitute("")
    with pytest.raises(RefusedError, match="degraded.deviation of safety.yaml does not name it"):
        bench.it.substitute("slew")
    with pytest.raises(RefusedError, match="there are valves for"):
        bench.it.substitute("elbow")
    bench.it.substitute("outer_boom")
    assert bench.it.substituted == "outer_boom"


def test_degraded_motion_is_slow() -> None:
    """A joint that follows its spool with a lag settles at the share of Table 2."""
    bench, limits = degraded(Bench()), MACHINE.limits[SUBSTITUTED]
    velocity, fastest = 0.0, 0.0
    for _ in range(1000):
        spool = told(bench, CYCLE, {SUBSTITUTED: 1.0}, velocity=velocity)
        velocity += (1.5 * limits.velocity_max * spool - velocity) * CYCLE / 0.1
        fastest = max(fastest, velocity)
    assert 0.5 * DEGRADED.speed * limits.velocity_max < velocity
    assert velocity < 1.05 * DEGRADED.speed * limits.velocity_max
    assert fastest < 2.0 * DEGRADED.speed * limits.velocity_max


def test_position_limits_hold_for_the_worst_possible_estimate() -> None:
    limit = MACHINE.limits[SUBSTITUTED].position_max
    at = limit - constants.LIMIT_MARGIN - constants.CAUTION_SIGMAS * SURE
    assert told(degraded(Bench()), 0.5, {SUBSTITUTED: 1.0}, position=at + 1e-4) == 0.0
    assert told(degraded(Bench()), 0.5, {SUBSTITUTED: 1.0}, position=at - 1e-2) > 0.0
    assert told(degraded(Bench()), 0.5, {SUBSTITUTED: -1.0}, position=at + 1e-4) < 0.0


def test_an_estimate_that_comes_late_is_a_fault() -> None:
    bench = degraded(Bench())
    bench.run(DEGRADED.timeout - 3 * CYCLE, {SUBSTITUTED: 0.0})
    assert state_of(bench) is SafetyState.DEGRADED
    bench.run(5 * CYCLE, {SUBSTITUTED: 0.0})
    fault = fault_of(bench)
    assert (fault.kind, fault.source) == (FaultKind.ESTIMATE, SUBSTITUTED)
    assert "limit 300 ms" in fault.detail


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_an_estimate_that_is_not_a_number_is_missing(wrong: float) -> None:
    bench = degraded(Bench())
    told(bench, DEGRADED.timeout + 2 * CYCLE, {SUBSTITUTED: 0.0}, position=wrong)
    assert fault_of(bench).kind is FaultKind.ESTIMATE


@pytest.mark.parametrize("condition", ["SEARCHING", "PRESSURES_LOST", "LOAD_IMPOSSIBLE", ""])
def test_an_estimate_in_a_condition_that_leads_no_joint_is_a_fault(condition: str) -> None:
    bench = degraded(Bench())
    told(bench, 0.5, {SUBSTITUTED: 0.0}, condition="ENCODER_LOST")
    assert state_of(bench) is SafetyState.DEGRADED
    told(bench, 2 * CYCLE, {SUBSTITUTED: 0.0}, condition=condition)
    assert fault_of(bench).kind is FaultKind.ESTIMATE
    assert f"its estimate is {condition}, not GOOD" in fault_of(bench).detail


def test_estimates_that_come_out_of_order_change_nothing() -> None:
    bench = degraded(Bench())
    told(bench, 0.5, {SUBSTITUTED: 0.0})
    for time in (bench.now - 0.1, bench.now + 10.0):
        bench.it.estimated(JointEstimate(time, 99.0, 99.0, 99.0, "GOOD"), bench.now)
        bench.run(CYCLE, {SUBSTITUTED: 0.0})
        assert state_of(bench) is SafetyState.DEGRADED


def test_an_uncertain_estimate_is_a_fault_and_prevents_enabling() -> None:
    bench, limit = degraded(Bench()), DEGRADED.deviation[SUBSTITUTED]
    told(bench, 0.5, {SUBSTITUTED: 0.0}, deviation=0.99 * limit)
    assert state_of(bench) is SafetyState.DEGRADED
    told(bench, 2 * CYCLE, {SUBSTITUTED: 0.0}, deviation=1.01 * limit)
    fault = fault_of(bench)
    assert fault.kind is FaultKind.ESTIMATE
    assert f"limit {limit:g}" in fault.detail
    bench.it.reset(bench.now)
    told(bench, 1.0)
    assert state_of(bench) is SafetyState.DISABLED
    told(bench, 2 * CYCLE, deviation=1.01 * limit)
    with pytest.raises(RefusedError, match="the standard deviation of its estimate"):
        bench.it.enable(bench.now)


def test_a_second_encoder_that_is_lost_is_a_fault() -> None:
    bench = degraded(Bench())
    lost = {**WITHOUT, "outer_boom": math.nan}
    bench.it.readings(lost, {**STILL, SUBSTITUTED: math.nan})
    bench.run(CYCLE, {SUBSTITUTED: 0.0})
    fault = fault_of(bench)
    assert fault.kind is FaultKind.NO_STATE
    assert "outer_boom" in fault.detail and SUBSTITUTED not in fault.detail


def test_a_mended_encoder_is_believed_again() -> None:
    bench = degraded(Bench())
    bench.it.disable()
    told(bench)
    bench.it.substitute("")
    bench.it.readings(MIDDLE, STILL)
    bench.it.enable(bench.now)
    assert state_of(bench) is SafetyState.ENABLED


def test_settings_that_permit_what_is_no_joint_are_refused(tmp_path: Path) -> None:
    text = machine_file("safety.yaml").read_text().replace("telescope: 0.06", "telescop: 0.06")
    (tmp_path / "safety.yaml").write_text(text)
    with pytest.raises(ConfigurationError, match="degraded.deviation' names telescop;"):
        load_safety(tmp_path / "safety.yaml", MACHINE)
