"""Which cycle a frame belongs to, by the counters of the messages that are sent together."""

from collections.abc import Sequence

from crane_driver.can.decoder import Readings
from crane_driver.can.layout import MessageLayout
from crane_driver.can.mapping import Timing

WAITING = 7  # cycles for which a frame is waited for; less than half a round of a 4-bit counter
AGREED = 3  # sets in a row with the same counters beside each other, before these are relied on


class CycleNumbers:
    """Numbers the frames of several messages so that those of one cycle have the same number.

    The counters of two messages need not be equal, but their difference stays the same while both
    are sent in every cycle. It is learnt from sets that belong together beyond doubt (`learn`), and
    forgotten when it may have changed, as after a restart of a device: when a message was missing,
    a counter jumped, or one message fell behind the others by half a round of its counter, or
    by as many cycles as a frame is waited for: devices with clocks of their own drift apart.
    """

    def __init__(self, messages: Sequence[MessageLayout], timing: Timing):
        self._layouts = {one.name: one for one in messages}
        self._timing = timing
        self._counters: dict[str, int] = {}
        self._last: dict[str, float] = {}  # s, steady
        self._count: dict[str, int] = {}  # cycles of each message since its counter was first seen
        self._newest = 0  # number
        self._offsets: dict[str, int] | None = None
        self._candidate: dict[str, int] = {}
        self._agreed = 0

    @staticmethod
    def possible(messages: Sequence[MessageLayout]) -> bool:
        """Whether all have a counter and the same cycle time."""
        counted = all(one.protection.counter for one in messages)
        return counted and len({one.cycle for one in messages}) == 1

    def number(self, readings: Readings) -> int | None:
        """Number of the frame's cycle, one more from cycle to cycle; None while it is not known."""
        message, counter = readings.message, readings.counter
        layout = self._layouts[message]
        if counter is None:
            self.forget()
            return None
        count, cycle = layout.protection.counter_count, layout.cycle
        silence = readings.steady - self._last.get(message, readings.steady)
        step = (counter - self._counters.get(message, counter)) % count
        if silence > self._timing.missing * cycle or step > self._timing.lost + 1:
            self.forget()
            step = 0
        self._counters[message], self._last[message] = counter, readings.steady
        self._count[message] = self._count.get(message, 0) + step
        if self._offsets is None:
            return None
        number = self._count[message] - self._offsets[message]
        if abs(number - self._newest) >= min(count // 2, WAITING):
            self.forget()
            return None
        self._newest = max(self._newest, number)
        return number

    def learn(self) -> None:
        """The newest frames of all messages belong to one cycle."""
        if self._count.keys() != self._layouts.keys():  # not all have come since `forget`
            return
        first = next(iter(self._layouts))
        offsets = {name: self._count[name] - self._count[first] for name in self._layouts}
        self._agreed = self._agreed + 1 if offsets == self._candidate else 1
        self._candidate = offsets
        if self._agreed >= AGREED:
            self._offsets = offsets
            self._newest = self._count[first]

    def forget(self) -> None:
        """Learn anew which counters belong together."""
        self._offsets, self._agreed = None, 0
        self._counters.clear()
        self._count.clear()
