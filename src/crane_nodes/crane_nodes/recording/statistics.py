"""What arrived on each topic, how fast, and whether anything was lost on the way."""

from collections.abc import Sequence


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
        """Count a message with the sequence number of its publisher, if the middleware has one."""
        self.count += 1
        if sequence is None:
            self.lost = None
        if self.lost is None or sequence is None:
            return
        if self._next is not None and sequence > self._next:
            self.lost += sequence - self._next
        self._next = sequence + 1  # a publisher that was started again begins at 1

    def published_by(self, publishers: int) -> None:
        """State how many publishers there are now."""
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
