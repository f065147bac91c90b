import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_identification.periodicity import detect_periodicity
from crane_model.errors import DataError

HARMONICS = np.arange(1, 6)


def smooth_step(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def reference(
    period: float,
    periods: float,
    rate: float,
    seed: int,
    approach: float = 5.0,
    run_up: float = 4.0,
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """A move to the path, a run-up along it, whole periods, a run-down: times and positions of
    three joints, and where the periods begin and end."""
    rng = np.random.default_rng(seed)
    begin, end = approach + run_up, approach + run_up + periods * period
    time = np.arange(0.0, end + run_up, 1 / rate)
    fine = np.linspace(0.0, time[-1], 20_001)
    speed = smooth_step((fine - approach) / run_up) - smooth_step((fine - end) / run_up)
    clock = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
    clock = np.interp(time, fine, clock - np.interp(begin, fine, clock))
    angle = np.outer(clock, 2 * np.pi / period * HARMONICS)
    a, b = rng.normal(size=(2, 5, 3)) / HARMONICS[:, None]
    position = np.sin(angle) @ a + np.cos(angle) @ b
    away = (1 - smooth_step(time / approach))[:, None] * rng.normal(size=3)
    return time, position + away, begin, end


@settings(max_examples=15, deadline=None)
@given(
    period=st.floats(10.0, 70.0),
    periods=st.integers(2, 4),
    rate=st.sampled_from([50.0, 100.0, 200.0]),
    seed=st.integers(0, 10_000),
)
def test_finds_period_and_periodic_part(
    period: float, periods: int, rate: float, seed: int
) -> None:
    time, position, begin, end = reference(period, periods, rate, seed)
    found = detect_periodicity(time, position)
    assert found.period == pytest.approx(period, rel=1e-5)
    assert found.start == pytest.approx(begin, abs=0.6)  # the end of the run-up is hardly visible
    assert found.end == pytest.approx(end, abs=0.6)
    assert found.end - found.start > (periods - 0.01) * period


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(-100.0, 100.0), scale=st.floats(0.01, 100.0))
def test_does_not_depend_on_clock_or_units(seed: int, shift: float, scale: float) -> None:
    time, position, *_ = reference(12.0, 2, 100.0, seed)
    found = detect_periodicity(time, position)
    moved = detect_periodicity(time + shift, scale * position)
    assert moved.period == pytest.approx(found.period, rel=1e-6)
    assert moved.start == pytest.approx(found.start + shift, abs=0.05)


@pytest.mark.parametrize("seed", range(8))
def test_long_approach_hides_nothing(seed: int) -> None:
    """Longer than the period, and only two periods after it."""
    time, position, begin, _ = reference(20.0, 2, 100.0, seed, approach=25.0)
    found = detect_periodicity(time, position)
    assert found.period == pytest.approx(20.0, rel=1e-5)
    assert found.start == pytest.approx(begin, abs=0.6)


def test_exactly_two_periods_and_nothing_else() -> None:
    time = np.arange(4000) / 100
    position = np.stack([np.sin(np.pi / 10 * time), np.cos(np.pi / 5 * time)], axis=1)
    found = detect_periodicity(time, position)
    assert found.period == pytest.approx(20.0, rel=1e-9)
    assert (found.start, found.end) == pytest.approx((0.0, 39.99))


def test_smallest_lag_counts_all_joints() -> None:
    time = np.arange(6000) / 100
    fast, slow = np.sin(2 * np.pi / 5 * time), np.sin(2 * np.pi / 15 * time)
    assert detect_periodicity(time, fast[:, None]).period == pytest.approx(5.0)
    assert detect_periodicity(time, np.stack([fast, slow], axis=1)).period == pytest.approx(15.0)


def test_jittering_stamps() -> None:
    time, position, *_ = reference(20.0, 3, 100.0, seed=1)
    rng = np.random.default_rng(2)
    stamps = time + rng.uniform(-2e-3, 2e-3, len(time))
    exact = np.stack([np.interp(stamps, time, column) for column in position.T], axis=1)
    assert detect_periodicity(stamps, exact).period == pytest.approx(20.0, rel=1e-5)


def test_one_period_is_not_enough_to_find_it_but_to_use_a_given_one() -> None:
    time, position, begin, end = reference(20.0, 1.5, 100.0, seed=3)
    with pytest.raises(DataError, match="at least two whole periods, give the period"):
        detect_periodicity(time, position)
    found = detect_periodicity(time, position, period=20.0)
    assert found.period == 20.0
    assert (found.start, found.end) == pytest.approx((begin, end), abs=0.6)


def test_wrong_period_is_refused() -> None:
    time, position, *_ = reference(20.0, 2, 100.0, seed=4)
    with pytest.raises(DataError, match=r"after the given period of 50\.0 s"):
        detect_periodicity(time, position, period=50.0)


def test_standing_still_is_not_periodic() -> None:
    time = np.arange(1000) / 100
    with pytest.raises(DataError, match="stands still"):
        detect_periodicity(time, np.ones((1000, 3)))
    step = smooth_step((time - 4.0) / 2.0)[:, None]  # stands, moves once, stands
    with pytest.raises(DataError, match="does not repeat itself"):
        detect_periodicity(time, step)


def test_references_that_were_not_recorded_do_not_end_the_repeating_part():
    """As where the node that publishes them was too busy for some cycles."""
    time, position, begin, end = reference(20.0, 3, 200.0, 7)
    rng = np.random.default_rng(8)
    kept = np.ones(len(time), dtype=bool)
    for at in rng.integers(1, len(time) - 5, 40):
        kept[at : at + rng.integers(1, 4)] = False
    found = detect_periodicity(time[kept], position[kept])
    assert found.period == pytest.approx(20.0, rel=1e-6)
    assert found.start == pytest.approx(begin, abs=0.3)
    assert found.end == pytest.approx(end, abs=0.3)
