"""Live signals are checked like a recording, once there are enough of them."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_identification.recording_check.corruption import chambers
from unit.crane_identification.recording_check.recorded import recorded

from crane_bags.clocks import TimeBack
from crane_identification import Log
from crane_identification.online.estimator import OnlineEstimator, OnlineOptions
from crane_identification.online.recent import (
    CHECK_PERIOD_S,
    CHECK_WINDOW_S,
    LEAST_WINDOW_S,
    Recent,
    Watched,
)
from crane_model import load_machine, load_model
from crane_model.machine_files import machine_file

TELESCOPE = 2


@pytest.fixture(scope="module")
def good() -> Log:
    return recorded()


def feed(recent: Recent | Watched, log: Log, start: float = 0.0, end: float = np.inf) -> None:
    """What a node hears from `start` to `end` [s]."""
    assert log.pressure_a is not None and log.pressure_b is not None
    for k, time in enumerate(log.position.time):
        if start <= time < end:
            stamp = round(1e9 * time)
            recent.add_position(stamp, log.position.value[k])
            recent.add_pressure(stamp, log.pressure_a.value[k], log.pressure_b.value[k])


def test_good_signals_are_not_suspected(good: Log) -> None:
    recent = Recent(load_machine(), PLANAR_JOINTS)
    recent.check()
    feed(recent, good, end=0.9 * LEAST_WINDOW_S)
    recent.check()
    assert recent.found is None
    feed(recent, good, start=0.9 * LEAST_WINDOW_S)
    recent.check()
    assert recent.found is not None
    assert not recent.found.suspicions and not recent.found.unchecked


def test_exchanged_chambers_are_told_while_the_crane_moves(good: Log) -> None:
    recent = Recent(load_machine(), PLANAR_JOINTS)
    feed(recent, chambers(good, TELESCOPE))
    recent.check()
    assert recent.found is not None
    (suspicion,) = recent.found.decisive
    assert suspicion.where == "telescope" and "chambers A and B" in suspicion.cause


def test_time_that_goes_back_begins_anew() -> None:
    """The same data a second time: nothing counts twice, and what happened is told."""
    log = recorded()
    estimator = OnlineEstimator(load_model(machine_file("model.yaml")), OnlineOptions())
    watched = Watched(estimator, Recent(load_machine(), PLANAR_JOINTS))
    feed(watched, log, end=12.0)
    once = estimator.samples
    feed(watched, log, end=12.0)
    assert estimator.samples == once > 0
    assert watched.back.times == 1 and watched.back.is_news
    assert str(watched.back).startswith("time went back by 12.0 s")


@pytest.mark.parametrize("pressures_first", [True, False])
def test_a_stream_that_lags_behind_a_set_back_loses_nothing(pressures_first: bool) -> None:
    """A busy node takes two seconds of a topic at once: one topic goes back long before the other,
    and the other still sends what it measured before."""
    estimator = OnlineEstimator(load_model(machine_file("model.yaml")), OnlineOptions())
    watched = Watched(estimator, Recent(load_machine(), PLANAR_JOINTS))
    still, loaded = np.array([0.6, -1.3, 0.3]), np.full(3, 5e6)
    step, back = 10_000_000, 200_000_000  # ns

    def take(pressures: bool, begin: int, end: int, shift: int = 0) -> None:
        for k in range(begin, end):
            if pressures:
                watched.add_pressure(k * step - shift, loaded, loaded)
            else:
                watched.add_position(k * step - shift, still)

    take(not pressures_first, 0, 300)
    take(pressures_first, 0, 500)
    take(pressures_first, 500, 710, back)
    take(not pressures_first, 300, 500)
    take(not pressures_first, 500, 800, back)
    take(pressures_first, 710, 800, back)
    assert watched.back.times == 1 and str(watched.back).startswith("time went back by 0.2 s")
    matcher = estimator.matcher
    assert matcher.matched > 290 and matcher.unmatched == 0


def test_a_stream_that_never_follows_a_set_back_counts_again() -> None:
    back = TimeBack()
    for topic in ("a", "b"):
        assert not back.lags(topic, 10**10) and not back.comes(topic, 10**10)
    assert back.comes("a", 0) and back.lags("b", 11 * 10**9)
    assert not back.lags("b", 5 * 10**9)  # it follows
    assert not back.comes("b", 5 * 10**9) and not back.lags("b", 6 * 10**9)


def test_messages_that_overtake_one_another_are_no_clock_that_is_set() -> None:
    back = TimeBack()
    assert not any(back.comes("a", stamp * 10**6) for stamp in (0, 50, 20, 60, 300, 210))
    assert back.times == 0
    assert back.comes("a", 190 * 10**6) and back.by == pytest.approx(0.11)
    assert not back.comes("b", 0)


def test_only_the_last_seconds_are_looked_at_and_not_too_often(good: Log) -> None:
    recent = Recent(None, PLANAR_JOINTS)
    for second in range(100):
        recent.add_position(second * 10**9, np.full(3, second))
        recent.add_pressure(second * 10**9, np.zeros(3), np.zeros(3))
    recent.check()
    first = recent.found
    assert first is not None
    recent.add_position(100 * 10**9, np.zeros(3))
    recent.check()
    assert recent.found is first
    for second in range(100, 100 + round(CHECK_PERIOD_S)):
        recent.add_position(second * 10**9, np.zeros(3))
        recent.add_pressure(second * 10**9, np.zeros(3), np.zeros(3))
    recent.check()
    assert recent.found is not first
    assert len(recent._log().position.time) <= CHECK_WINDOW_S + 1
    recent.add_position(0, np.zeros(3))  # the clock was set back
    recent.add_pressure(0, np.zeros(3), np.zeros(3))
    assert len(recent._log().position.time) == 1
