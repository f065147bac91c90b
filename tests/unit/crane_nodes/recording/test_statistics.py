"""Losses by sequence numbers, rates, and tables."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_nodes.recording.statistics import Arrivals, table


def arrivals(sequences: list[int | None], publishers: int = 1) -> Arrivals:
    one = Arrivals(publishers, now=0.0)
    for sequence in sequences:
        one.arrived(sequence)
    return one


@given(st.sets(st.integers(2, 200), max_size=198))
def test_every_missing_number_is_a_lost_message(dropped: set[int]) -> None:
    """The first message that arrives says where counting begins, the last where it ends."""
    received = [k for k in range(1, 202) if k not in dropped]
    one = arrivals(list(received))
    assert (one.count, one.lost) == (len(received), len(dropped))


def test_what_was_sent_before_the_subscription_is_not_lost() -> None:
    assert arrivals([500, 501, 502]).lost == 0


def test_publisher_that_is_started_again_loses_nothing() -> None:
    assert arrivals([500, 501, 1, 2, 3]).lost == 0


def test_another_publisher_takes_over() -> None:
    one = arrivals([1, 2, 3])
    one.published_by(0)
    one.published_by(1)
    one.arrived(900)
    assert one.lost == 0


@pytest.mark.parametrize("publishers", [1, 2])
def test_losses_of_several_publishers_are_not_known(publishers: int) -> None:
    one = arrivals([1, 2], publishers)
    one.published_by(2)
    one.arrived(700)
    assert (one.count, one.lost) == (3, None)


def test_middleware_without_sequence_numbers() -> None:
    one = arrivals([None, None])
    assert (one.count, one.lost) == (2, None)


def test_rate_is_of_the_last_period() -> None:
    one = Arrivals(1, now=10.0)
    for period, count in enumerate([100, 50, 0], start=1):
        for _ in range(count):
            one.arrived(None)
        one.measure(10.0 + 0.5 * period)
        assert one.rate == count / 0.5


def test_table_has_straight_columns() -> None:
    text = table(("topic", "type", "messages"), [("/a", "x", "7"), ("/long/name", "y", "12345")])
    assert text.splitlines() == [
        "topic       type  messages",
        "/a          x            7",
        "/long/name  y        12345",
    ]
