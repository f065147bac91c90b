"""How far sums of residuals may go."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import Sums
from crane_observer.monitor.tolerance import between

COUNT = 50
LATE = 0.01  # s


@given(
    arrays(float, (COUNT, 2), elements=st.floats(0.0, 1.0)),
    st.lists(st.tuples(st.integers(0, COUNT - 1), st.integers(0, COUNT - 1)), min_size=1),
)
def test_a_late_command_counts_by_the_largest_speed_on_the_way(
    steps: np.ndarray, spans: list[tuple[int, int]]
) -> None:
    way = np.cumsum(steps, axis=0)
    sums = Sums(BLOCK * np.arange(COUNT), np.zeros_like(way), way, np.zeros_like(way))
    begin, end = np.array(spans).T
    _, may = between(np.array([1.0, 0.0, 0.0, LATE]), sums, begin, end)
    speeds = np.diff(way, axis=0, prepend=way[:1]) / BLOCK
    for (first, last), found in zip(spans, may, strict=True):
        fastest = speeds[min(first, last) : max(first, last) + 1].max(axis=0)
        np.testing.assert_allclose(found, 1.0 + 2.0 * LATE * fastest)
