"""What follows from the findings of the sensor monitor, and what does not."""

import pytest
from unit.crane_driver.safety.supervised import CYCLE, SAFETY, Bench

from crane_driver import FaultKind
from crane_driver.safety.commands import RefusedError
from crane_driver.safety.plausibility import FaultyEncoders
from crane_driver.safety.supervisor import SafetyState

FOUND = {"inner_boom": "its encoder: drift"}


def reset(bench: Bench) -> Bench:
    bench.run(1.0)
    bench.it.reset(bench.now)
    bench.run(SAFETY.settling_time + 2 * CYCLE)
    return bench


def state_of(bench: Bench) -> SafetyState:
    """Of now: a checker must not take it for that of before."""
    return bench.it.state


def test_a_faulty_encoder_stops_the_crane() -> None:
    bench = Bench().moving()
    bench.it.encoders_found_faulty(FOUND, before=False)
    assert state_of(bench) is SafetyState.FAULT
    fault = bench.it.faults.first
    assert fault is not None
    assert (fault.kind, fault.source) == (FaultKind.FAULTY_ENCODER, "inner_boom")
    assert "drift" in bench.it.cause
    assert not bench.run(1.0)[-1].enabled


def test_it_is_not_enabled_before_the_monitor_forgets() -> None:
    bench = Bench().moving()
    bench.it.encoders_found_faulty(FOUND, before=False)
    reset(bench)
    assert state_of(bench) is SafetyState.DISABLED
    with pytest.raises(RefusedError, match=r"inner_boom: its encoder: drift; repair it and let"):
        bench.it.enable(bench.now)
    bench.it.encoders_found_faulty(
        {"inner_boom": "its encoder: scale"}, before=False
    )  # looked at again
    assert state_of(bench) is SafetyState.DISABLED
    bench.it.encoders_found_faulty({}, before=False)
    bench.it.enable(bench.now)
    assert state_of(bench) is SafetyState.ENABLED
    bench.it.encoders_found_faulty(FOUND, before=False)
    assert state_of(bench) is SafetyState.FAULT


def test_a_finding_older_than_the_driver_is_reported_and_ignored() -> None:
    bench = Bench().moving()
    bench.it.encoders_found_faulty(FOUND, before=True)
    assert state_of(bench) is SafetyState.ENABLED
    (news,) = [one for one in bench.it.log if "inner_boom" in one.text]
    assert "before this driver started" in news.text
    bench.it.encoders_found_faulty(FOUND | {"telescope": "its encoder: stuck"}, before=False)
    assert state_of(bench) is SafetyState.FAULT
    assert bench.it.faults.first is not None
    assert bench.it.faults.first.source == "telescope"
    assert bench.it.log.count(news) == 1


def test_the_encoder_that_is_substituted_may_be_faulty() -> None:
    bench = Bench()
    bench.run(SAFETY.settling_time + 2 * CYCLE)
    bench.it.substitute("inner_boom")
    bench.it.encoders_found_faulty(FOUND, before=False)
    assert state_of(bench) is SafetyState.DISABLED


def test_findings_of_one_joint_leave_another_to_be_found() -> None:
    faulty = FaultyEncoders()
    first, _ = faulty.take(FOUND, before=False)
    again, _ = faulty.take(FOUND | {"slew": "its encoder: jump"}, before=False)
    assert [one.source for one in first] == ["inner_boom"]
    assert [one.source for one in again] == ["slew"]
    assert "inner_boom" in faulty.problem("slew")
    assert "slew" not in faulty.problem("slew")
