"""Clocks of publishers: which stamps cannot be what the clock of the recorder says."""

import math
import time
from typing import NamedTuple

import numpy as np

NANOSECONDS = 1_000_000_000  # in a second
MAX_JUMP_NS = NANOSECONDS // 10
"""Between two messages that were received one right after the other, the stamps may jump by this
much [ns]: a message may be late, or overtake another."""
SAME_STEP_S = 1.0  # in which the stamps of several topics go back by one and the same step
NEWS_S = 10.0  # for which it is told that time went back
REGULAR_NS = NANOSECONDS  # over which the two clocks are compared to tell drift from steps
MIN_INTERVALS = (
    10  # so many of these make a recording at least, so that one with a step in it does not count
)

MAX_MISORDERED_SHARE = 0.02
"""Share of messages that are older than one before them, from which on times are not known."""


class SetBack(NamedTuple):
    """Time that goes back from message to message, in the order of arrival."""

    times: int  # how often
    largest: int  # ns, by which it goes back at most from one message to the next
    interval: int  # ns, by which it usually goes on
    behind: int  # messages that are older than one before them
    total: int  # messages
    logged: bool  # log times go back, too: it was not a message that overtook another one

    @property
    def share(self) -> float:
        """Share of messages that are older than one before them."""
        return self.behind / self.total

    @property
    def spoils(self) -> bool:
        """Return whether so many messages are out of order that times are not known."""
        return self.share > MAX_MISORDERED_SHARE

    def __str__(self) -> str:
        where = "stamps and log times" if self.logged else "stamps"
        return (
            f"time goes back {self.times} time{'s' * (self.times > 1)}, by up to "
            f"{self.largest / NANOSECONDS:.3g} s from a message to the next, which usually is "
            f"{self.interval / NANOSECONDS:.3g} s later, in {where}"
        )


def set_back(stamp: np.ndarray, log_time: np.ndarray) -> SetBack | None:
    """How often and how far stamps (n,) [ns] go back; None if they never do."""
    if not len(stamp):
        return None
    steps = np.diff(stamp)
    if not (back := steps < 0).any():
        return None
    return SetBack(
        times=int(np.count_nonzero(back)),
        largest=-int(steps.min()),
        interval=int(np.median(steps)),
        behind=int(np.count_nonzero(stamp < np.maximum.accumulate(stamp))),
        total=len(stamp),
        logged=bool((np.diff(log_time)[back] < 0).any()),
    )


def clock_step(stamp: np.ndarray, log_time: np.ndarray) -> tuple[int, int] | None:
    """Message at which the publisher's clock was set, and by how much [ns]; None if it never was.

    Of header stamps (n,) and log times (n,) [ns] in the order of reception. The delay between the
    two then changes at one message and stays changed. A message that is late changes it for a
    while, a recorder that pauses is late in both, and of a clock that drifts it changes steadily.
    The first message may be of any age: a latched one waits for its recorder.
    """
    if len(stamp) < 3:
        return None
    late = log_time - stamp
    jump = np.diff(late)
    sudden = (np.abs(jump) > MAX_JUMP_NS) & (np.diff(log_time) < MAX_JUMP_NS)
    sudden[0] &= jump[0] > 0
    suspects = np.flatnonzero(sudden)
    if not len(suspects):
        return None
    steady = late - _drift(stamp, late)
    before = np.minimum.accumulate(steady)[suspects]
    after = np.minimum.accumulate(steady[::-1])[::-1][suspects + 1]
    change = np.abs(after - before)
    worst = int(change.argmax())
    if change[worst] <= MAX_JUMP_NS:
        return None
    return int(suspects[worst]) + 1, -int(jump[suspects[worst]])


def _drift(stamp: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(n,) [ns] what a steady drift adds to the delay: by the median over neighbours."""
    since = stamp - stamp[0]
    interval = float(np.median(np.abs(np.diff(stamp)))) or 1.0
    apart = max(min(round(REGULAR_NS / interval), len(stamp) // MIN_INTERVALS), 1)
    elapsed = stamp[apart:] - stamp[:-apart]
    forward = elapsed > 0
    if not forward.any():
        return np.zeros(len(stamp))
    rate = np.median((late[apart:] - late[:-apart])[forward] / elapsed[forward])
    return rate * since


class TimeBack:
    """Stamps of topics that go back: a clock was set, or a bag is played in a loop.

    `times`: how often; `by` [s]: how far the last time.
    """

    def __init__(self) -> None:
        self.times, self.by = 0, 0.0
        self._newest: dict[str, int] = {}
        self._behind: dict[str, int] = {}  # the same of topics that have not yet followed the step
        self._last = -math.inf

    def lags(self, topic: str, stamp: int) -> bool:
        """Return whether the topic still sends what it measured before the stamps of another went
        back, though not for longer than the step is news."""
        newest = self._behind.pop(topic, None)
        if newest is None or newest - stamp > MAX_JUMP_NS or not self.is_news:
            return False
        self._behind[topic] = max(newest, stamp)
        return True

    def comes(self, topic: str, stamp: int) -> bool:
        """Take the stamp [ns] of a message; return whether everything has to begin anew.

        Messages may overtake one another by `MAX_JUMP_NS`. What topics that lag still send from
        before the step, is a step as well, but is not counted again.
        """
        newest = self._newest.get(topic, stamp)
        if newest - stamp <= MAX_JUMP_NS:
            self._newest[topic] = max(newest, stamp)
            return False
        now = time.monotonic()
        if now - self._last > SAME_STEP_S:
            self.times += 1
        self._behind |= self._newest
        del self._behind[topic]
        self.by, self._last, self._newest = (newest - stamp) / NANOSECONDS, now, {topic: stamp}
        return True

    @property
    def is_news(self) -> bool:
        return time.monotonic() - self._last < NEWS_S

    def __str__(self) -> str:
        return f"time went back by {self.by:.1f} s: started again"
