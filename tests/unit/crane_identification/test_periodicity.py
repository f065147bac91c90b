import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_identification.preparation.periodicity import detect_periodicity
from crane_model import DataError

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
    with pytest.raises(DataError, match="record at least two whole periods"):
        detect_periodicity(time, position)
    found = detect_periodicity(time, position, period=20.0)
    assert found.period == 20.0
    assert (found.start, found.end) == pytest.approx((begin, end), abs=0.6)


def test_wrong_period_is_refused() -> None:
    time, position, *_ = reference(20.0, 2, 100.0, seed=4)
    with pytest.raises(DataError, match="after the given period of 50 s: .* repeats after 20 s"):
        detect_periodicity(time, position, period=50.0)


def test_standing_still_is_not_periodic() -> None:
    time = np.arange(1000) / 100
    with pytest.raises(DataError, match="stands still"):
        detect_periodicity(time, np.ones((1000, 3)))
    step = smooth_step((time - 4.0) / 2.0)[:, None]  # stands, moves once, stands
    with pytest.raises(DataError, match="motion does not repeat"):
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


def measured(position: np.ndarray, seed: int, noise: float = 2e-4) -> np.ndarray:
    """Read by noisy encoders of low resolution."""
    rng = np.random.default_rng(seed)
    return 1e-3 * np.round((position + noise * rng.normal(size=position.shape)) / 1e-3)


@pytest.mark.parametrize(("rate", "joints"), [(20.0, 3), (200.0, 3), (200.0, 1)])
def test_measured_positions_show_the_period_too(rate: float, joints: int) -> None:
    """With approach, run-up and run-down, of which little may count as periodic."""
    time, position, begin, end = reference(20.0, 3, rate, seed=3)
    found = detect_periodicity(time, measured(position[:, :joints], 1))
    assert found.period == pytest.approx(20.0, abs=2e-3)
    assert found.start == pytest.approx(begin, abs=1.0)
    assert found.end == pytest.approx(end, abs=1.5)


def test_standing_for_longer_than_a_period_hides_nothing() -> None:
    """Before the motion, in the middle of the approach, and behind it."""
    _, position, begin, end = reference(20.0, 3, 100.0, seed=5)
    held = [np.repeat(position[k : k + 1], 7000, axis=0) for k in (0, 300, -1)]
    position = np.concatenate([held[0], position[:300], held[1], position[300:], held[2]])
    found = detect_periodicity(np.arange(len(position)) / 100, measured(position, 2))
    assert found.period == pytest.approx(20.0, abs=2e-3)
    assert found.start == pytest.approx(begin + 140.0, abs=1.0)
    assert found.end == pytest.approx(end + 140.0, abs=1.5)


@pytest.mark.parametrize("small", [0.2, 0.05, 0.01])
def test_a_small_fundamental_makes_the_period_longer(small: float) -> None:
    angle = 2 * np.pi / 20.0 * np.arange(8000) / 100
    position = np.sin(2 * angle) + small * np.sin(angle)
    found = detect_periodicity(np.arange(8000) / 100, measured(position[:, None], 3))
    assert found.period == pytest.approx(20.0, abs=2e-3)


@pytest.mark.parametrize("beside", ["creeps", "is noise"])
def test_a_joint_that_hardly_moves_hides_nothing(beside: str) -> None:
    time = np.arange(8000) / 100
    second_joint = 1e-4 * time if beside == "creeps" else np.zeros(8000)
    angle = 2 * np.pi / 20.0 * time
    position = np.stack([np.sin(angle) + 0.3 * np.cos(3 * angle), second_joint], axis=1)
    found = detect_periodicity(time, measured(position, 4, noise=1e-3))
    assert found.period == pytest.approx(20.0, abs=5e-3)


@pytest.mark.parametrize("period", [10.0, 19.0, 20.1, 66.0])
def test_a_given_period_is_checked(period: float) -> None:
    time, position, *_ = reference(20.0, 3, 100.0, seed=3)
    position = measured(position, 5)
    with pytest.raises(DataError, match=rf"period of {period:g} s: .* it repeats after 20 s; corr"):
        detect_periodicity(time, position, period)
    assert detect_periodicity(time, position, 20.0).period == 20.0


@pytest.mark.parametrize("samples", [2000, 2040, 3000])
def test_less_than_two_given_periods_are_checked_as_far_as_they_go(samples: int) -> None:
    time = np.arange(samples) / 100
    position = measured(np.sin(2 * np.pi / 20.0 * time + 0.3)[:, None], 6)
    assert detect_periodicity(time, position, 20.0).period == 20.0
    with pytest.raises(DataError, match="given period of 17 s"):
        detect_periodicity(time, position, 17.0)
    with pytest.raises(DataError, match="less than the given period of 66 s"):
        detect_periodicity(time, position, 66.0)


def test_motion_that_does_not_repeat_is_refused_with_a_number() -> None:
    """A chirp, a walk by hand, and a drift of a tenth of the stroke a period."""
    time = np.arange(8000) / 100
    angle = 2 * np.pi / 20.0 * time
    rng = np.random.default_rng(7)
    walk = np.cumsum(np.cumsum(rng.normal(size=(8000, 2)), axis=0), axis=0)
    for position in (
        np.sin(angle * (1 + time / 40))[:, None],
        walk / np.ptp(walk, axis=0),
        (np.sin(angle) + 0.1 * time / 20)[:, None],
    ):
        with pytest.raises(
            DataError, match=r"still differs by \d+% of its rms; .* --from and --to"
        ):
            detect_periodicity(time, measured(position, 8))
