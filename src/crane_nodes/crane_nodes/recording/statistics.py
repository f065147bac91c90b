"""Statistics of recorded topics: counts, rates, losses and silences."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

SHORTEST_SILENCE_S = 3.0
SILENCE_PAUSES = 5.0  # times
SEEN_S = 10.0
SEEN_PAUSES = 10.0  # times


class Arrivals:
    """Messages of one topic.

    Losses are counted by the sequence numbers of the publisher. These do not say which publisher
    they are of, so that of a topic with several the losses are not known.

    count: messages; lost: messages, None where not known; rate: Hz, over the last period.
    """

    def __init__(self, publishers: int, now: float):
        self.count = 0
        self.lost: int | None = 0
        self.rate = 0.0
        self._next: int | None = None
        self._publishers = 0
        self._measured = (now, 0)
        self.published_by(publishers)

    def arrived(self, sequence: int | None) -> None:
        self.count += 1
        if sequence is None:
            self.lost = None
        if self.lost is None or sequence is None:
            return
        if self._next is not None and sequence > self._next:
            self.lost += sequence - self._next
        self._next = sequence + 1  # a publisher that was started again begins at 1

    def published_by(self, publishers: int) -> None:
        if publishers > 1:
            self.lost = None
        if publishers != self._publishers:
            self._next = None
        self._publishers = publishers

    def measure(self, now: float) -> None:
        """End a period of `rate`; `now` [s] is of a steady clock."""
        begin, count = self._measured
        self.rate = (self.count - count) / (now - begin)
        self._measured = (now, self.count)


def shown(lost: int | None) -> str:
    """The number of lost messages as text."""
    return "unknown" if lost is None else str(lost)


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Text in columns: the first two to the left, numbers behind them to the right."""
    lines = [headings, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(headings))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k < 2 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


class Rhythm(Enum):
    """Expected rhythm of a topic."""

    CONTINUOUS = auto()
    ANY = auto()  # nothing: latched, or sent now and then
    UNKNOWN = auto()  # to be learned


@dataclass(frozen=True)
class Span:
    """A silence [s, steady clock]."""

    begin: float
    end: float

    @property
    def seconds(self) -> float:
        return self.end - self.begin


class Silence:
    """The silences of one topic that has a publisher.

    A continuous topic of the suite is silent after `SHORTEST_SILENCE_S` without a message, even if
    none came yet. The rhythm of a topic that the suite does not know has to be seen first: it is
    silent after `SILENCE_PAUSES` times its longest pause, once it has come for `SEEN_S` and for
    `SEEN_PAUSES` times that pause. Latched topics, and those of the suite that pause, never are.

    since: when the present silence began [s, steady clock]; None while there is none; over: those
    that have ended, by a message or because the publisher has gone.
    """

    def __init__(self, rhythm: Rhythm):
        self.since: float | None = None
        self.over: list[Span] = []
        self._rhythm = rhythm
        self._first: float | None = None  # message
        self._last = 0.0  # message
        self._pause = 0.0  # the longest
        self._there: float | None = None  # since when there is a publisher

    def arrived(self, now: float) -> None:
        if self._first is None:
            self._first = now
        else:
            self._pause = max(self._pause, now - self._last)
        self._last = now
        self._end(now)

    def look(self, publishers: int, now: float) -> None:
        """Judge at `now`, with so many publishers that are heard."""
        if not publishers:
            self._there = None
            self._end(now)
            return
        if self._there is None or now < self._there:
            self._there = now
        begin = self._there if self._first is None else max(self._there, self._last)
        if self.since is None and now - begin > self._longest():
            self.since = begin

    def spans(self, now: float) -> list[Span]:
        return self.over + self._present(now)

    def _longest(self) -> float:
        if self._rhythm is Rhythm.CONTINUOUS:
            return SHORTEST_SILENCE_S
        if self._rhythm is Rhythm.UNKNOWN and self._first is not None:
            seen = self._last - self._first
            if seen >= SEEN_S and seen >= SEEN_PAUSES * self._pause:
                return max(SHORTEST_SILENCE_S, SILENCE_PAUSES * self._pause)
        return float("inf")

    def _end(self, now: float) -> None:
        self.over += self._present(now)
        self.since = None

    def _present(self, now: float) -> list[Span]:
        """The silence until `now`; none if the time went back, as when simulated time begins."""
        if self.since is None or now < self.since:
            return []
        return [Span(self.since, now)]
