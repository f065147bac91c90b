"""Messages that come late, each topic in its own way."""

from hypothesis import given
from hypothesis import strategies as st

from crane_observer.node.observer_node import LONGEST_WAIT, InOrder

MS = 1_000_000  # ns
CYCLE = 5 * MS


@given(st.lists(st.integers(0, 18), min_size=3, max_size=3), st.integers(3, 60))
def test_topics_that_lag_by_some_cycles_are_put_in_order(lags: list[int], count: int) -> None:
    order: InOrder[str] = InOrder()
    taken = []
    for k in range(count):
        for topic, lag in enumerate(lags):
            if k >= lag:
                order.add((k - lag) * CYCLE, topic, "")
        if k >= max(lags):
            taken += order.take()
    stamps = [stamped[:2] for stamped in taken]
    assert stamps == sorted(stamps)
    if count > max(lags):
        assert stamps[-1][0] == (count - 1 - max(lags)) * CYCLE


def test_a_topic_that_ends_holds_nothing_up_for_long() -> None:
    order: InOrder[str] = InOrder()
    order.add(0, 1, "the last command")
    for k in range(100):
        order.add(k * CYCLE, 0, "pressures")
    newest = order.take()[-1]
    assert newest.stamp == 99 * CYCLE
    order.add(100 * CYCLE, 0, "pressures")
    assert order.take()[-1].stamp == 100 * CYCLE
    assert LONGEST_WAIT < 99 * CYCLE


def test_a_stamp_that_went_back_is_not_lost() -> None:
    order: InOrder[str] = InOrder()
    order.add(10 * CYCLE, 0, "new")
    order.add(2 * CYCLE, 0, "old")
    assert [stamped.message for stamped in order.take()] == ["old", "new"]
    assert order.take() == []
