"""Which cycle a frame belongs to, by the counters of the messages that are sent together."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from crane_driver.can.decoder import Readings
from crane_driver.can.layout import MessageLayout
from crane_driver.can.mapping import Timing

WAITING = 7  # cycles for which a frame is waited for; less than half a round of a 4-bit counter
LEARNT = 60  # frames of each message, after which it is known which counters belong together
PATIENCE = 4  # times as many, after which it is believed that devices sample at different instants
KNOWN_AGAIN = 5  # frames of each, that show that what was known before a pause still holds
ALIKE = 0.25  # cycles between promptest frames, below which they are of one instant of sampling
APART = 0.6  # cycles, beyond which devices with clocks of their own have drifted by a whole one
BLOCK, BLOCKS = 10, 30  # frames, of which one is prompt, and how many of these are remembered
DOUBTFUL = 2  # blocks, whose promptest frame may have a wrong index
EARLY, LATE = 0.5, 1.5  # cycles from when it is expected, at which a lone frame is recognised
TIMED = 20  # frames, after which it is known when others are to be expected
REFUSED = 10  # frames in a row that do not fit, after which their device counts anew


@dataclass(slots=True)
class _Stream:
    """The frames of one message: `index` (from 0), counter and reception [s] of the newest.

    `base`: when its frame of index 0 came [s], had it been as prompt as the promptest of late, by
    the `bases` of the promptest in blocks of frames. `unsure`: until when [s] frames may be of a
    whole round of the counter ago. `refused`: how many did not fit, in a row.
    """

    cycle: float
    index: int
    counter: int
    received: float
    frames: int = 0
    base: float = math.inf
    bases: deque[float] = field(default_factory=lambda: deque(maxlen=BLOCKS))
    unsure: float = -math.inf
    refused: int = 0

    def take(self, index: int, counter: int, received: float) -> None:
        """The newest frame."""
        self.frames += 1
        self.refused = 0
        self.index, self.counter, self.received = index, counter, received
        base = received - index * self.cycle
        if self.frames % BLOCK == 1:
            self.bases.append(base)
        else:
            self.bases[-1] = min(self.bases[-1], base)
        # Not the smallest: one frame whose index is wrong would seem to have come early.
        self.base = sorted(self.bases)[min(len(self.bases) // 2, DOUBTFUL)]

    def early(self, index: int, received: float) -> float:
        """By how many cycles a frame comes before the promptest would."""
        return index - (received - self.base) / self.cycle

    def expected(self, step: int, count: int, received: float) -> int | None:
        """Index of a frame whose counter is `step` ahead, by the time; None if none fits it."""
        late = -self.early(self.index + step, received)
        rounds = round(late / count)
        fits = -EARLY < late - rounds * count < LATE
        return self.index + step + rounds * count if fits and step + rounds * count > 0 else None


class CycleNumbers:
    """Numbers the frames of several messages so that those of one cycle have the same number.

    Each message counts for itself; which counts belong to one instant of sampling is learnt from
    the promptest frames, since a frame may be late and is never early. Nothing is known until then.
    All is learnt anew, in another `epoch`, where a counter and the time contradict each other, as
    after the restart of a device.

    A frame that others overtake is left out. One that is late by a whole round of its counter
    cannot always be told from a new one.
    """

    def __init__(self, messages: Sequence[MessageLayout], timing: Timing):
        self._layouts = {one.name: one for one in messages}
        self._missing = timing.missing
        self._lost = timing.lost
        self._streams: dict[str, _Stream] = {}
        self._offsets: dict[str, int] = {}
        self._former: dict[str, int] = {}  # counters beside each other before a pause
        self.epoch = 0

    @staticmethod
    def possible(messages: Sequence[MessageLayout]) -> bool:
        """Whether all have a counter and the same cycle time."""
        counted = all(one.protection.counter for one in messages)
        return counted and len({one.cycle for one in messages}) == 1

    @property
    def known(self) -> bool:
        """Whether frames have numbers."""
        return bool(self._offsets)

    def place(self, readings: Readings) -> int | None:
        """Index of a frame among those of its message; None where that cannot be told."""
        if readings.counter is None:
            self._forget(restarted=True)
            return None
        layout = self._layouts[readings.message]
        stream = self._streams.get(readings.message)
        if stream is None:
            stream = _Stream(layout.cycle, 0, readings.counter, readings.steady)
            self._streams[readings.message] = stream
            index: int | None = 0
        else:
            index = self._index(stream, layout.protection.counter_count, readings)
        if index is None:
            stream.refused += 1
            if stream.refused > REFUSED:
                self._forget(restarted=True)
            return None
        stream.take(index, readings.counter, readings.steady)
        if self._offsets:
            self._follow(readings.message)
        else:
            self._learn()
        return index

    def _index(self, stream: _Stream, count: int, readings: Readings) -> int | None:
        """Frames keep their order, but for few that others overtake, which are not told apart from
        those of a device that counts anew.
        """
        assert readings.counter is not None
        received = readings.steady
        silence = (received - stream.received) / stream.cycle
        step = (readings.counter - stream.counter) % count
        if silence > self._missing:  # whoever comes back may count anew
            self._forget(restarted=True)
            return None
        if silence > count - WAITING:
            stream.unsure = received + stream.cycle
        # After a silence, frames that were held up come at once: without a gap, or not to be told
        # from those of a round ago.
        follows = 0 < step <= (1 if received < stream.unsure else self._lost + 1)
        if stream.frames < TIMED:
            follows = follows and silence <= count - WAITING
            if not follows and step <= count - WAITING:  # else perhaps overtaken by others
                self._forget(restarted=False)
            return stream.index + step if follows else None
        if stream.early(stream.index + step + count, received) < EARLY:
            follows = False  # a whole round more may be true
        if follows and stream.early(stream.index + step, received) < EARLY:
            return stream.index + step
        return None if received < stream.unsure else stream.expected(step, count, received)

    def settle(self) -> None:
        """No more frames come: what the few that came show must do, if it is clear."""
        if self._offsets or self._streams.keys() != self._layouts.keys():
            return
        offsets, alike = self._seen()
        if alike:
            self._offsets = offsets

    def number(self, message: str, index: int, received: float) -> int | None:
        """Number of the cycle of a frame, once they are known: one more from cycle to cycle.

        None for one that would have come before it was sent: its index was taken too early.
        """
        if self._streams[message].early(index, received) > EARLY:
            return None
        return index - self._offsets[message]

    def _learn(self) -> None:
        if self._streams.keys() != self._layouts.keys():
            return
        frames = min(one.frames for one in self._streams.values())
        offsets, alike = self._seen()
        again = frames >= KNOWN_AGAIN and self._counters(offsets) == self._former
        sure = alike and (again or frames >= LEARNT)
        if sure or frames >= PATIENCE * LEARNT or len(self._layouts) == 1:
            self._offsets = offsets

    def _seen(self) -> tuple[dict[str, int], bool]:
        """By how many cycles the messages run apart, and whether they are of one instant."""
        apart = {name: self._apart(name) for name in self._layouts}
        offsets = {name: round(value) for name, value in apart.items()}
        return offsets, all(abs(apart[name] - offsets[name]) < ALIKE for name in apart)

    def _follow(self, name: str) -> None:
        """Devices with clocks of their own drift apart: now and then one is a cycle behind."""
        drift = self._apart(name) - self._offsets[name]
        if abs(drift) > APART:
            self._offsets[name] += 1 if drift > 0.0 else -1

    def _apart(self, name: str) -> float:
        """By how many cycles the index of a message runs before that of the first one."""
        first, own = next(iter(self._layouts)), self._streams[name]
        return (self._streams[first].base - own.base) / own.cycle

    def _counters(self, offsets: dict[str, int]) -> dict[str, int]:
        """What the counters of one cycle are beyond that of the first message."""
        values = {
            name: self._streams[name].counter - self._streams[name].index + offset
            for name, offset in offsets.items()
        }
        first = next(iter(values.values()))
        return {
            name: (value - first) % self._layouts[name].protection.counter_count
            for name, value in values.items()
        }

    def _forget(self, restarted: bool) -> None:
        if restarted:
            self._former = {}
        elif self._offsets:
            self._former = self._counters(self._offsets)
        self._streams, self._offsets = {}, {}
        self.epoch += 1
