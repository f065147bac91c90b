"""Which silences of a topic are named, on a clock of the test's own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_nodes.recording.statistics import (
    SHORTEST_SILENCE_S,
    SILENCE_PAUSES,
    Rhythm,
    Silence,
    Span,
)

PERIOD = 0.25  # s, of looking


def listened(
    rhythm: Rhythm, messages: list[float], until: float, gone: float = np.inf
) -> list[Span]:
    """Silences of a topic with `messages` at these times, whose publisher goes at `gone`."""
    one, left = Silence(rhythm), sorted(messages)
    for now in np.arange(0.0, until, PERIOD):
        while left and left[0] <= now:
            one.arrived(left.pop(0))
        one.look(int(now < gone), now)
    return one.spans(until)


@pytest.mark.parametrize("rate", [1.0, 200.0])
def test_a_continuous_topic_that_stops_is_silent_until_it_comes_again(rate: float) -> None:
    before, after = np.arange(1.0, 20.0, 1.0 / rate), np.arange(77.0, 90.0, 1.0 / rate)
    (span,) = listened(Rhythm.CONTINUOUS, [*before, *after], 90.0)
    assert (span.begin, span.end) == pytest.approx((before[-1], 77.0))


def test_a_continuous_topic_that_never_comes_is_silent_from_its_publisher_on() -> None:
    assert listened(Rhythm.CONTINUOUS, [], 57.0) == [Span(0.0, 57.0)]


def test_a_silence_before_simulated_time_begins_is_not_negative() -> None:
    topic = Silence(Rhythm.CONTINUOUS)
    topic.look(1, 0.0)
    topic.look(1, 100.0)
    topic.look(1, 200.0)
    topic.arrived(0.1)  # the clock begins
    topic.look(1, 0.2)
    assert topic.since is None
    assert all(span.seconds >= 0.0 for span in topic.spans(0.3))


def test_a_silence_ends_where_the_publisher_goes() -> None:
    assert listened(Rhythm.CONTINUOUS, [], 60.0, gone=20.0) == [Span(0.0, 20.0)]
    assert listened(Rhythm.CONTINUOUS, [], 60.0, gone=SHORTEST_SILENCE_S) == []


def test_what_is_latched_or_pauses_is_never_silent() -> None:
    assert listened(Rhythm.ANY, [*np.arange(0.0, 20.0, 0.005)], 500.0) == []


def test_an_unknown_topic_is_silent_when_it_falls_out_of_its_rhythm() -> None:
    fast, slow = np.arange(0.0, 20.0, 0.01), np.arange(0.0, 200.0, 5.0)
    assert listened(Rhythm.UNKNOWN, [*fast], 60.0)[0].begin == pytest.approx(fast[-1])
    assert listened(Rhythm.UNKNOWN, [*slow], 195.0 + 5.0 * SILENCE_PAUSES) == []
    assert listened(Rhythm.UNKNOWN, [*slow], 300.0) == [Span(195.0, 300.0)]


def test_a_few_messages_are_no_rhythm() -> None:
    assert listened(Rhythm.UNKNOWN, [], 300.0) == []
    assert listened(Rhythm.UNKNOWN, [1.0, 1.1, 1.2, 5.0], 300.0) == []


@given(st.integers(0, 999), st.floats(0.2, 20.0))
def test_events_are_never_silent(seed: int, mean: float) -> None:
    """They come by chance: five times the longest pause among so many is as good as impossible."""
    pauses = np.random.default_rng(seed).exponential(mean, 100)
    assert listened(Rhythm.UNKNOWN, [*np.cumsum(pauses)], float(pauses.sum())) == []
