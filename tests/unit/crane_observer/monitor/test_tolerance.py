"""How far sums of residuals may go."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import Sums
from crane_observer.monitor.tolerance import ROOM, between, learn
from crane_observer.monitor.trim import TERMS

COUNT = 50
LATE, CREEP = 0.01, 0.03  # s, m/s


@given(
    arrays(float, (COUNT, 2), elements=st.floats(0.0, 1.0)),
    st.lists(st.tuples(st.integers(0, COUNT - 1), st.integers(0, COUNT - 1)), min_size=1),
)
def test_a_late_command_counts_by_the_largest_speed_on_the_way(
    steps: np.ndarray, spans: list[tuple[int, int]]
) -> None:
    way = np.cumsum(steps, axis=0)
    zeros = np.zeros_like(way)
    sums = Sums(BLOCK * np.arange(COUNT), zeros, way, zeros, np.zeros((*way.shape, TERMS)))
    begin, end = np.array(spans).T
    _, may = between(np.array([1.0, 0.0, 0.0, CREEP, LATE]), sums, begin, end)
    speeds = np.diff(way, axis=0, prepend=way[:1]) / BLOCK
    for (first, last), found in zip(spans, may, strict=True):
        fastest = speeds[min(first, last) : max(first, last) + 1].max(axis=0)
        lasting = BLOCK * abs(last - first)
        np.testing.assert_allclose(found, 1.0 + CREEP * lasting + 2.0 * LATE * fastest)


def test_tolerances_hold_what_was_seen_and_little_more() -> None:
    """Of residuals that follow the way alone, a share is learnt, and no more than their largest."""
    rng = np.random.default_rng(2)
    way = np.cumsum(np.abs(rng.standard_normal((3000, 3))) * 1e-3, axis=0)
    residual = 5e-3 * way
    zeros = np.zeros_like(way)
    sums = Sums(BLOCK * np.arange(3000), residual, way, zeros, np.zeros((*way.shape, TERMS)))
    learnt = learn(("boom",), [sums], "made").rows
    begin = np.arange(2000)
    moved, may = between(learnt, sums, begin, begin + 500)
    assert (ROOM * moved[:, :2] <= may[:, :2] * 1.0001).all()
    assert (may[:, :2] < 1.2 * ROOM * moved[:, :2]).all()
