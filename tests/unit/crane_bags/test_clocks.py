"""Time that goes back, told from messages that overtake one another."""

import numpy as np
import pytest

from crane_bags import clocks
from crane_bags.clocks import TimeBack, clock_step, set_back

MS = 1_000_000  # ns


class Steady:
    """The steady clock, set by hand."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> Steady:
    made = Steady()
    monkeypatch.setattr(clocks, "time", made)
    return made


def test_a_stamp_that_is_repeated_does_not_go_back() -> None:
    stamp = np.array([0, 5, 5, 10]) * MS
    assert set_back(stamp, stamp) is None


@pytest.mark.parametrize(("stamps", "words"), [([0, 4, 8, 6, 10], "1 time,"), (None, "2 times,")])
def test_how_often_and_how_far_is_told(stamps: list[int] | None, words: str) -> None:
    stamp = np.array(stamps or [0, 4, 2, 6, 10, 8, 12, 16]) * MS
    back = set_back(stamp, np.arange(len(stamp)) * MS)
    assert words in str(back)
    assert "by up to 0.002 s" in str(back)
    assert "usually is 0.004 s later, in stamps" in str(back)


@pytest.mark.parametrize("older", [0, 50, 100])  # ms
def test_a_message_that_is_overtaken_is_no_step(older: int) -> None:
    back = TimeBack()
    assert not back.comes("joint_states", 20_000 * MS)
    assert not back.comes("joint_states", (20_000 - older) * MS)
    assert back.times == 0


def test_a_step_is_counted_once_for_all_topics_and_is_news_for_a_while(steady: Steady) -> None:
    back = TimeBack()
    for topic in ("joint_states", "cylinder_pressures"):
        assert not back.comes(topic, 20_000 * MS)
    assert back.comes("joint_states", 8_000 * MS)
    assert not back.comes("cylinder_pressures", 8_000 * MS)  # begun anew, with it
    assert (back.times, back.by) == (1, 12.0)
    steady.now += 9.0
    assert back.is_news
    assert back.comes("joint_states", 4_000 * MS)
    assert back.times == 2
    steady.now += 11.0
    assert not back.is_news


def test_a_clock_that_drifts_is_never_set() -> None:
    """Over ten minutes by a second, with messages that come in bursts."""
    stamp = np.repeat(np.arange(0, 600_000, 20), 2) * MS
    log_time = np.round(stamp * (1.0 + 1.0 / 600.0)).astype(np.int64)
    assert clock_step(stamp, log_time) is None
    log_time[len(stamp) // 2 :] += 300 * MS
    assert clock_step(stamp, log_time) is None, "the recorder paused"
    stamp[len(stamp) // 2 :] -= 300 * MS
    log_time[len(stamp) // 2 :] -= 300 * MS
    row, step = clock_step(stamp, log_time) or (0, 0)
    assert row == len(stamp) // 2
    assert step == pytest.approx(-300 * MS, rel=0.01)
