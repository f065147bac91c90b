import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_identification.averaging import fold, noise_of_mean, transient_periods


@given(n=st.integers(1, 200), length=st.integers(1, 50), data=st.data())
def test_fold_takes_the_last_whole_periods(n: int, length: int, data: st.DataObject) -> None:
    periods = data.draw(st.integers(0, n // length))
    values = np.arange(n)
    folded = fold(values, length, periods)
    assert folded.shape == (periods, length)
    np.testing.assert_array_equal(folded.ravel(), values[n - periods * length :])


def noisy(periods: int, seed: int, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = np.sin(2 * np.pi * np.arange(400) / 400)[:, None] * np.array([1.0, 5.0])
    return truth, truth + noise * rng.normal(size=(periods, 400, 2))


def test_noise_of_mean_is_the_error_of_the_mean() -> None:
    """Against the truth, which the estimate has not seen."""
    truth, periods = noisy(periods=6, seed=1)
    used = np.ones((400, 2), dtype=bool)
    actual = np.sqrt(((periods.mean(axis=0) - truth) ** 2).mean(axis=0))
    np.testing.assert_allclose(noise_of_mean(periods, used), actual, rtol=0.1)


def test_noise_of_mean_counts_used_samples_only() -> None:
    _, periods = noisy(periods=4, seed=2)
    used = np.ones((400, 2), dtype=bool)
    used[100:200, 0] = False
    spoilt = periods.copy()
    spoilt[0, 100:200, 0] += 100.0
    np.testing.assert_array_equal(noise_of_mean(spoilt, used), noise_of_mean(periods, used))


def test_one_period_has_no_scatter() -> None:
    _, periods = noisy(periods=1, seed=3)
    assert np.isnan(noise_of_mean(periods, np.ones((400, 2), dtype=bool))).all()


@pytest.mark.parametrize("periods", [3, 4, 6])
def test_repeating_periods_are_all_kept(periods: int) -> None:
    assert transient_periods(noisy(periods, seed=4)[1]) == 0


def test_transient_of_one_joint_takes_its_periods_out() -> None:
    _, periods = noisy(5, seed=5)
    decay = np.exp(-np.arange(800) / 150).reshape(2, 400)
    periods[:2, :, 1] += 30.0 * decay
    assert transient_periods(periods) == 2


def test_two_periods_are_always_left() -> None:
    periods = np.geomspace(1000.0, 1.0, 4)[:, None, None] * np.ones((4, 50, 1))  # never settles
    assert transient_periods(periods) == 2
    assert transient_periods(periods[:2]) == 0
