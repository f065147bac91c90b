"""Readings that several frames of one cycle bring, put together without mixing cycles."""

import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from crane_bags.clocks import MAX_JUMP_NS
from crane_driver import constants
from crane_driver.can.codec import Readings
from crane_driver.can.layout import Layout, MessageLayout
from crane_driver.can.mapping import Timing
from crane_driver.can.stream import Beat, FrameStream, SamplingClock, find_beat, measured_cycle


class Placed(NamedTuple):
    """A frame and the number of its cycle, one more from cycle to cycle of an epoch.

    If it is not `proven`, the cycle can be another one by whole rounds of the counter.
    """

    epoch: int
    number: int
    proven: bool
    readings: Readings


class CycleNumbers:
    """Numbers the frames of several messages so that those of one cycle have the same number.

    Each message counts for itself, by counter and time (see `FrameStream`); which counts belong to
    one instant of sampling is learnt from prompt frames, since a frame may be late and is never
    early. Until then frames wait. All is learnt anew, in another `epoch`, where a device may have
    restarted, and where counter and time contradict each other.
    """

    def __init__(self, messages: Sequence[MessageLayout], timing: Timing):
        self._layouts = {layout.name: layout for layout in messages}
        self._missing = timing.missing
        alone = len(messages) == 1  # of nothing that it could be confused with
        self._least, self._refusals = (
            (1, 0) if alone else (constants.LEARNING_FRAMES, constants.MOST_REFUSED_FRAMES)
        )
        self._streams: dict[str, FrameStream] = {}
        self._offsets: dict[str, int] = {}
        self._cycle = messages[0].cycle  # s, as measured
        self._waiting: deque[Readings] = deque()
        self._heard: dict[str, float] = {}  # while they wait: reception of the newest [s]
        self._held: defaultdict[str, list[Placed]] = defaultdict(list)  # in doubt, by message
        self._waited = 0  # frames since all was forgotten
        self._refused = 0
        self._epoch = 0
        self.dropped: Counter[str] = Counter()  # frames whose cycle is not known, by message

    @staticmethod
    def possible(messages: Sequence[MessageLayout]) -> bool:
        """Return whether all have a counter and the same cycle time."""
        counted = all(message.protection.counter for message in messages)
        return counted and len({message.cycle for message in messages}) == 1

    def place(self, readings: Readings) -> list[Placed]:
        """The frames that have a number now, in order of reception."""
        counter = self._counter(readings)
        if counter is None:
            self.dropped[readings.message] += 1
            return []
        if not self._streams:
            return self._wait(readings)
        stream = self._streams[readings.message]
        if stream.silence(readings.steady) > self._missing:  # whoever comes back may count anew
            self._forget()
            return self._wait(readings)
        index, proven = stream.index(counter, readings.steady)
        self._refused = 0 if proven else self._refused + 1
        if self._refused > self._refusals or not stream.known:
            self._forget()
            return self._wait(readings)
        if proven:
            self._follow(readings.message)
        number = index - self._offsets[readings.message]
        self._held[readings.message].append(Placed(self._epoch, number, proven, readings))
        return [] if stream.doubtful else self._held.pop(readings.message)

    def settle(self) -> list[Placed]:
        """No more frames come: those that wait, if what the few that came show is clear."""
        placed = self._learn(1)
        self.dropped.update(frame.message for frame in self._waiting)
        self._waiting.clear()
        self._forget()
        return placed

    def _counter(self, readings: Readings) -> int | None:
        """From 0; None where there is none, or one that does not exist."""
        protection = self._layouts[readings.message].protection
        if readings.counter is None:
            return None
        counter = readings.counter - protection.counter_first
        return counter if 0 <= counter < protection.counter_count else None

    def _wait(self, readings: Readings) -> list[Placed]:
        waiting, message = self._waiting, readings.message
        since = self._heard.get(message, readings.steady)
        self._heard[message] = readings.steady
        if readings.steady - since > self._missing * self._layouts[message].cycle:
            return self.settle() + self._wait(readings)
        waiting.append(readings)
        if len(waiting) > constants.MOST_WAITING_FRAMES * len(self._layouts):
            self.dropped[waiting.popleft().message] += 1
        self._waited += 1
        ready = self._least == 1 or self._waited % constants.LEARN_AGAIN_FRAMES == 0
        return self._learn(self._least) if ready else []

    def _learn(self, least: int) -> list[Placed]:
        """Find out, from at least so many frames of each message, which belong together."""
        if self._heard.keys() != self._layouts.keys():
            return []
        received: dict[str, list[float]] = {name: [] for name in self._layouts}
        counters: dict[str, list[int]] = {name: [] for name in self._layouts}
        for frame in self._waiting:
            counter = self._counter(frame)
            assert counter is not None  # others do not wait
            received[frame.message].append(frame.steady)
            counters[frame.message].append(counter)
        frames = min(len(times) for times in received.values())
        if frames < least:
            return []
        beats: dict[str, Beat] = {}
        most = constants.LONGEST_LEARNING_RATIO * constants.LEARNING_FRAMES
        self._cycle = self._common_cycle(received, counters)
        for name, layout in self._layouts.items():
            times, counts = np.array(received[name][-most:]), np.array(counters[name][-most:])
            beat = find_beat(times, counts, self._cycle, layout.protection.counter_count)
            if beat is None:
                return []
            beats[name] = beat
        first = next(iter(beats.values()))
        apart = {name: (first.base - beat.base) / self._cycle for name, beat in beats.items()}
        alike = all(
            abs(value - round(value)) < constants.SAME_INSTANT_CYCLES for value in apart.values()
        )
        if not alike and frames < most:
            return []
        return self._begin(beats, {name: round(value) for name, value in apart.items()})

    def _common_cycle(
        self, received: dict[str, list[float]], counters: dict[str, list[int]]
    ) -> float:
        """Cycle time of all messages [s]: those sampled together have one."""
        measured = [
            measured_cycle(
                np.array(received[name][-constants.LEARNING_FRAMES :]),
                np.array(counters[name][-constants.LEARNING_FRAMES :]),
                layout.cycle,
                layout.protection.counter_count,
            )
            for name, layout in self._layouts.items()
        ]
        if max(measured) - min(measured) > constants.LARGEST_CLOCK_DRIFT * min(measured):
            return next(iter(self._layouts.values())).cycle
        return float(np.mean(measured))

    def _begin(self, beats: dict[str, Beat], offsets: dict[str, int]) -> list[Placed]:
        self._streams = {
            name: FrameStream(self._cycle, layout.protection.counter_count, beats[name])
            for name, layout in self._layouts.items()
        }
        self._offsets, self._refused = offsets, 0
        waiting = list(self._waiting)
        self._waiting.clear()
        placed = []
        for frame in waiting:
            if self._streams and frame.steady < beats[frame.message].received:
                self.dropped[frame.message] += 1
            else:
                placed += self.place(frame)
        return placed

    def _follow(self, name: str) -> None:
        """Devices with clocks of their own drift apart: now and then one is a cycle behind."""
        first, stream = next(iter(self._streams.values())), self._streams[name]
        drift = (first.base - stream.base) / stream.cycle - self._offsets[name]
        if abs(drift) > constants.DRIFTED_APART_CYCLES:
            self._offsets[name] += 1 if drift > 0.0 else -1

    def _forget(self) -> None:
        self.dropped.update({name: len(held) for name, held in self._held.items()})
        self._held.clear()
        self._streams, self._offsets, self._heard = {}, {}, {}
        self._waited = 0
        self._epoch += 1


class Complete(NamedTuple):
    """The readings of one cycle."""

    stamp: int  # ns since the epoch, of the sampling
    sampled: float  # s, steady, likewise
    received: float  # s, steady, of the first of the frames
    values: dict[str, float]  # all names, in the layout's order; NaN where it is no measurement


@dataclass(slots=True)
class _Set:
    """Values and faults of one cycle."""

    stamp: int
    steady: float
    values: dict[str, float]
    arrived: set[str] = field(default_factory=set)


class Assembly:
    """Collects the positions or the pressures of a layout from all frames that carry them.

    Frames belong together by their counters, however late a frame is received. Until it is known
    which counters belong together, frames wait. Where the mapping names no counters, frames belong
    together if they were received within half a cycle.

    Numbered cycles are stamped with the instant at which they were sampled (see `SamplingClock`),
    others with the reception of their first frame. Stamps increase unless the clock is set back.
    """

    def __init__(self, layout: Layout, kind: Literal["positions", "pressures"]):
        carriers = [message for message in layout.readings if getattr(message, kind)]
        self._kind = kind
        self._messages = frozenset(message.name for message in carriers)
        self._cycle = min((message.cycle for message in carriers), default=0.0)
        self._unknown = dict.fromkeys(getattr(layout, kind), math.nan)
        self._numbers = (
            CycleNumbers(carriers, layout.timing) if CycleNumbers.possible(carriers) else None
        )
        self._epoch = 0
        self._clock = SamplingClock(self._cycle)
        self._open: dict[int, _Set] = {}  # by number of the cycle, in order of arrival
        self._done: int | None = -1 if self._numbers is None else None  # the last complete cycle
        self._last = Complete(0, -math.inf, -math.inf, {})
        self._given_up = 0

    @property
    def incomplete(self) -> int:
        """Cycles given up: a frame is missing, came too late, or may be of another cycle."""
        dropped = self._numbers.dropped.values() if self._numbers else ()
        return self._given_up + max(dropped, default=0)

    def add(self, readings: Readings) -> list[Complete]:
        """The cycles that this frame completes, oldest first; none while others are to come."""
        if readings.message not in self._messages:
            return []
        if self._numbers is None:
            complete = self._add(self._number_by_time(readings), readings)
            return [complete] if complete else []
        return self._numbered(self._numbers.place(readings))

    def finish(self) -> list[Complete]:
        return self._numbered(self._numbers.settle()) if self._numbers else []

    def _numbered(self, placed: Iterable[Placed]) -> list[Complete]:
        complete = []
        for frame in placed:
            if frame.epoch != self._epoch or self._done is None:
                self._begin(frame)
            complete.append(self._add(frame.number, frame.readings, frame.proven))
        return [cycle for cycle in complete if cycle]

    def _begin(self, first: Placed) -> None:
        """Numbers begin anew; what has come so far stays in pieces."""
        self._give_up(list(self._open))
        self._epoch, self._done = first.epoch, first.number - constants.LONGEST_WAIT_CYCLES
        self._clock = SamplingClock(self._cycle)

    def _number_by_time(self, readings: Readings) -> int:
        """That of the open set, unless the frame cannot be of it."""
        assert self._done is not None
        if not self._open:
            return self._done + 1
        ((number, open_set),) = self._open.items()
        late = readings.steady - open_set.steady > self._cycle / 2
        if not late and readings.message not in open_set.arrived:
            return number
        self._give_up([number])
        return number + 1

    def _add(self, number: int, readings: Readings, proven: bool = True) -> Complete | None:
        assert self._done is not None
        if number <= self._done:  # a later cycle was complete before
            return None
        cycle = self._open.get(number)
        if cycle is None:
            cycle = _Set(readings.stamp, readings.steady, dict(self._unknown))
            self._open[number] = cycle
            self._give_up(
                [old for old in self._open if old <= number - constants.LONGEST_WAIT_CYCLES]
            )
        elif readings.message in cycle.arrived:
            return None  # repeated
        if not proven:  # counted, if no other completes it
            return None
        if not cycle.arrived:
            cycle.stamp, cycle.steady = readings.stamp, readings.steady
        cycle.arrived.add(readings.message)
        cycle.values.update(getattr(readings, self._kind))
        if len(cycle.arrived) < len(self._messages):
            return None
        del self._open[number]
        self._give_up([old for old in self._open if old < number])
        self._done = number
        return self._stamped(number, cycle)

    def _stamped(self, number: int, cycle: _Set) -> Complete | None:
        """None, and given up, if it was not sampled after the last one: a clock is wrong.

        If the wall clock goes back by more than `MAX_JUMP_NS`, it was set, and stamps follow it.
        """
        sampled = self._clock.sampled(number, cycle.steady) if self._numbers else cycle.steady
        stamp = cycle.stamp - round((cycle.steady - sampled) * 1e9)
        back = self._last.stamp - stamp  # ns
        if sampled <= self._last.sampled or 0 <= back <= MAX_JUMP_NS:
            self._given_up += 1
            return None
        self._last = Complete(stamp, sampled, cycle.steady, cycle.values)
        return self._last

    def _give_up(self, numbers: list[int]) -> None:
        for number in numbers:
            del self._open[number]
        self._given_up += len(numbers)
