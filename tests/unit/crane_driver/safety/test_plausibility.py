"""Which readings of an encoder are not believed, and which are."""

import math

import numpy as np
import pytest
from unit.crane_driver.safety.supervised import CYCLE, MACHINE, SAFETY

from crane_driver import Fault, FaultKind
from crane_driver.safety.plausibility import PositionWatch, believed

STEP = 1e-4  # rad, of the encoder
LIMITS = MACHINE.limits["inner_boom"]
FASTEST = max(LIMITS.velocity_max, -LIMITS.velocity_min)
NONE = (math.nan, math.nan)


def watch() -> PositionWatch:
    return PositionWatch("inner_boom", LIMITS, STEP, CYCLE, SAFETY)


def first_fault(positions, spools, pressures=None, times=None) -> tuple[int, Fault] | None:
    one = watch()
    times = CYCLE * np.arange(len(positions)) if times is None else times
    pressures = [NONE] * len(positions) if pressures is None else pressures
    for k, reading in enumerate(zip(times, positions, spools, pressures, strict=True)):
        if fault := one.observe(*reading):
            return k, fault
    return None


def test_a_frozen_encoder_under_an_open_valve_is_a_fault_within_half_a_second() -> None:
    rng = np.random.default_rng(1)
    noise = STEP * rng.integers(-1, 2, 200)  # one step to either side
    (k, fault) = first_fault(0.3 + noise, np.full(200, 0.3))
    assert SAFETY.still_time < k * CYCLE <= 0.5
    assert "has not changed for 405 ms with its valve open by 0.30" in str(fault)
    assert fault.kind is FaultKind.FROZEN


@pytest.mark.parametrize("spool", [0.0, 0.04, SAFETY.opening])
def test_a_joint_whose_valve_need_not_move_it_may_stand(spool: float) -> None:
    assert first_fault(np.full(400, 0.3), np.full(400, spool)) is None


def test_a_valve_that_hunts_to_both_sides_need_not_move_the_joint() -> None:
    spools = 0.3 * np.sign(np.sin(2 * np.pi * 2.0 * CYCLE * np.arange(400)))
    assert first_fault(np.full(400, 0.3), spools) is None


def test_a_joint_that_crawls_is_believed() -> None:
    """A count in 50 ms, at the least opening that surely moves it."""
    positions = STEP * np.floor(CYCLE * np.arange(800) / 0.05)
    assert first_fault(positions, np.full(800, SAFETY.opening + 0.01)) is None


def test_pressures_that_move_betray_an_encoder_that_does_not() -> None:
    """Below the opening that surely moves the joint; under such a change oil gives by much more."""
    pressures = [(8e6 + 1e4 * k, 3e6) for k in range(400)]
    _, fault = first_fault(np.full(400, 0.3), np.full(400, 0.08), pressures)
    assert "while its pressures changed by 30 bar" in str(fault)
    assert first_fault(np.full(400, 0.3), np.zeros(400), pressures) is None  # closed


@pytest.mark.parametrize("jump", [-0.5, 0.03])
def test_a_jump_is_a_fault_at_once(jump: float) -> None:
    positions = np.where(np.arange(50) < 20, 0.3, 0.3 + jump)
    k, fault = first_fault(positions, np.zeros(50))
    assert k == 20
    assert f"jumped by {jump:.3g} in 5 ms" in str(fault)
    assert fault.kind is FaultKind.JUMPED


def test_the_fastest_joint_and_lost_cycles_are_no_jump() -> None:
    times = CYCLE * np.cumsum(np.random.default_rng(2).choice([1, 1, 1, 4], 300))
    positions = 0.9 * SAFETY.jump_speed * FASTEST * times
    assert first_fault(positions, np.full(300, 1.0), times=times) is None


def test_frames_that_come_close_together_are_no_jump() -> None:
    """Stamped with their reception, two cycles may come within a millisecond."""
    times = CYCLE * np.arange(100) + np.where(np.arange(100) % 2, 0.0, 0.004)
    positions = 2.0 * FASTEST * CYCLE * np.arange(100)
    assert first_fault(positions, np.full(100, 1.0), times=times) is None


def test_what_is_not_believed_is_not_given_on_and_told_once() -> None:
    watches = {"inner_boom": watch()}
    told = []
    for k in range(5):
        values = {"inner_boom": 0.3 if k < 2 else 1.3, "slew": 0.1}
        found, wrong = believed(watches, k * CYCLE, values, {"inner_boom": 0.0}, {})
        told.append([fault.source for fault in wrong])
        assert found["slew"] == 0.1
        assert math.isnan(found["inner_boom"]) == (k >= 2)
    assert told == [[], [], ["inner_boom"], [], []]


def test_a_reading_that_is_no_measurement_is_judged_by_others() -> None:
    positions = np.full(200, math.nan)
    assert first_fault(positions, np.full(200, 0.5)) is None
