"""How far apart false alarms are, told from a short time: against distributions that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from crane_observer.monitor.tolerance import level

ONCE_IN = 3600.0  # windows: once in ten hours of ten seconds each
LAWS = {
    "exponential": stats.expon(scale=0.3),
    "Gumbel": stats.gumbel_r(loc=0.5, scale=0.05),
    "Gaussian": stats.norm(loc=0.5, scale=0.1),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_level_is_the_quantile_of_what_is_rare(name: str) -> None:
    """From 150 windows; the Gaussian's tail is thinner than the exponential one: no less, then."""
    law, rng = LAWS[name], np.random.default_rng(7)
    levels = [level(law.rvs(150, random_state=rng), ONCE_IN) for _ in range(300)]
    low, spread = law.isf(1.0 / ONCE_IN), law.isf(1.0 / ONCE_IN) - law.median()
    assert low - 0.05 * spread < np.median(levels) < low + 0.45 * spread


@pytest.mark.parametrize("windows", [6, 12, 30, 150, 2000])
def test_alarms_are_as_far_apart_as_wanted(windows: int) -> None:
    """The mean rate over many recordings, of a minute or of hours, within a factor of 1.5."""
    law, rng = stats.expon(), np.random.default_rng(8)
    rates = [law.sf(level(law.rvs(windows, random_state=rng), ONCE_IN)) for _ in range(2000)]
    assert 1.0 / 1.5 < np.mean(rates) * ONCE_IN < 1.5


def test_the_level_falls_as_the_recording_grows() -> None:
    law, rng = stats.expon(), np.random.default_rng(9)
    levels = [
        np.median([level(law.rvs(windows, random_state=rng), ONCE_IN) for _ in range(300)])
        for windows in (6, 30, 150, 2000)
    ]
    assert (np.diff(levels) < 0.0).all()


values = arrays(float, st.integers(2, 40), elements=st.floats(0.0, 10.0))


@given(values, st.floats(0.1, 10.0), st.floats(-5.0, 5.0), st.floats(1.0, 1e6))
def test_units_do_not_matter_and_longer_is_higher(
    largest: np.ndarray, unit: float, zero: float, windows: float
) -> None:
    found = level(largest, windows)
    assert level(unit * largest + zero, windows) == pytest.approx(unit * found + zero, abs=1e-6)
    assert level(largest, 2.0 * windows) >= found


@pytest.mark.parametrize("windows", [0, 1])
def test_nothing_is_told_from_next_to_nothing(windows: int) -> None:
    with pytest.raises(ValueError, match=f"{windows} windows .* at least two are needed"):
        level(np.zeros(windows), ONCE_IN)
