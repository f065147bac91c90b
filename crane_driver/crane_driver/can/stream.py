"""Order and sampling of a device's frames, by their counters and times of reception."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from crane_driver import constants


class Beat(NamedTuple):
    """When the frames of a message are to come, by prompt ones."""

    base: float  # s, reception of index 0, if it were prompt; an index has the counter's remainder
    received: float  # s, from when on indices are proven
    passed: int  # index that all of these are beyond


def measured_cycle(received: np.ndarray, counters: np.ndarray, cycle: float, count: int) -> float:
    """True cycle time [s] of a device, from evenly received frames (n,); else `cycle`."""
    if len(received) < constants.TELLING_FRAMES or ((np.diff(counters) % count) != 1).any():
        return cycle
    index = np.arange(len(received))
    slope, first = np.polyfit(index, received - received[0], 1)
    uneven = np.abs(received - received[0] - first - slope * index).max()
    off = abs(slope / cycle - 1.0)
    clear = constants.CLEAR_TREND_RATIO * uneven < off * cycle * len(received)
    even = uneven < constants.PROMPT_WITHIN_CYCLES * cycle
    return (
        float(slope)
        if even
        and clear
        and constants.LARGEST_CLOCK_DRIFT < off < constants.LARGEST_CYCLE_DEVIATION
        else cycle
    )


def find_beat(received: np.ndarray, counters: np.ndarray, cycle: float, count: int) -> Beat | None:
    """The beat of frames with `counters` (n,) from 0 to count - 1, `received` (n,) [s]; None if
    they show no clear one.

    Prompt frames all come at the same instant of their cycle, in the place of the round that their
    counter says, none comes before, and late frames follow at any time.
    """
    late = (received / cycle - counters) % count  # cycles, from any origin
    ordered = np.sort(late)
    ends = np.searchsorted(
        np.concatenate([ordered, ordered + count]), ordered + constants.PROMPT_WITHIN_CYCLES
    )
    support = ends - np.arange(len(ordered))
    best = int(support.argmax())
    before = ordered - np.roll(ordered, 1)
    before[0] += count
    ahead = (ordered[best] - ordered[before >= count / constants.EMPTY_PART_OF_ROUND]) % count
    enough = min(
        len(late), max(constants.LEAST_SUPPORT_FRAMES, len(late) // constants.LEAST_SUPPORT_PART)
    )
    if support[best] < enough or not len(ahead) or ahead.min() > constants.EARLIEST_CYCLES:
        return None
    base = ordered[best] * cycle
    late = (late - ordered[best]) % count
    indices = np.round((received - base) / cycle - late)
    # No older one may follow the first that counts: it would be late by a whole round.
    following = np.append(np.minimum.accumulate(indices[::-1])[::-1][1:], math.inf)
    firsts = np.flatnonzero((late < constants.PROMPT_WITHIN_CYCLES) & (following > indices))
    if not len(firsts):
        return None
    first = firsts[0]
    begin, passed = float(received[first]), int(indices[first])
    if first == 0 or begin - received[first - 1] >= constants.OVERTAKEN_AFTER_CYCLES * cycle:
        return Beat(base, begin, passed - 1)
    return Beat(base, math.nextafter(begin, math.inf), passed)  # others may have overtaken it


class FrameStream:
    """Tells the index of each frame, which is proven where

    - no frame comes more than `OVERTAKEN_AFTER_CYCLES` after one that was sent later,
    - no frame comes before one that is as prompt as any would, and one of `PROMPT_AMONG_FRAMES` is,
    - a device is silent for longer than `RESTART_SILENCE_CYCLES` before it counts anew,

    for then it is newer than all that came before, no newer than the time allows, and only one
    index in between has its counter. While these hold, a wrong index cannot be proven but where,
    after a silence, late frames of a new count look like prompt ones of the old.
    """

    def __init__(self, cycle: float, count: int, beat: Beat):
        self.cycle, self.base = cycle, beat.base
        self._count = count
        self._overtaken = min(constants.OVERTAKEN_AFTER_CYCLES, count // 4) * cycle
        self._passed = self._newest = beat.passed
        self._recent: deque[tuple[float, int]] = deque()  # may still be followed by older ones
        self._received = beat.received
        self._late = 0  # frames since the last prompt one
        self.doubtful = False  # the device may have restarted, until a prompt frame comes
        self.known = True  # when frames are to come

    def silence(self, received: float) -> float:
        """Cycles from the newest frame to a reception: the longest silence of the sender."""
        return (received - self.base) / self.cycle - self._newest

    def index(self, counter: int, received: float) -> tuple[int, bool]:
        """Index of a frame, and whether it is proven; else it may be wrong by whole rounds."""
        while self._recent and received - self._recent[0][0] >= self._overtaken:
            self._passed = max(self._passed, self._recent.popleft()[1])
        index = self._passed + 1 + (counter - self._passed - 1) % self._count
        late = (received - self.base) / self.cycle - index
        if late < -constants.EARLIEST_CYCLES:
            self.known, self.doubtful = not self.doubtful, True
            return index - self._count, False
        if late >= self._count - constants.EARLIEST_CYCLES:
            return index, False
        self._late = 0 if late < constants.EARLIEST_CYCLES else self._late + 1
        self.doubtful = (
            self.doubtful or self.silence(received) > constants.RESTART_SILENCE_CYCLES
        ) and self._late > 0
        self.known = self._late <= (
            constants.DOUBTED_FRAMES if self.doubtful else constants.PROMPT_AMONG_FRAMES
        )
        self._newest = max(self._newest, index)
        self._recent.append((received, index))
        self.base = min(
            self.base + constants.LARGEST_CLOCK_DRIFT * (received - self._received),
            received - index * self.cycle,
        )
        self._received = received
        return index, True


class CycleReception(NamedTuple):
    """A cycle of a device and when it was received [s, steady]."""

    number: int
    received: float


class SamplingClock:
    """The even clock by which a device samples, seen through receptions that are late at times.

    A frame is never early: over the number of its cycle, receptions lie on or above the straight
    line of the device's clock, and the frames without delay lie on it. That line is the edge of the
    lower convex hull of the last receptions below their middle, which follows any drift of the two
    clocks. Source: Zhang, Liu, Xia, Clock synchronization algorithms for network measurements,
    IEEE INFOCOM 2002.
    """

    def __init__(self, cycle: float):
        self._cycle = cycle
        self._last = -math.inf
        self._begin()

    def sampled(self, number: int, received: float) -> float:
        """When cycle `number` was sampled [s, steady], but for the delay that all frames have.

        Numbers and receptions [s, steady] increase from call to call. Never later than `received`,
        and the same as long as the clock is not known.
        """
        self._extend(CycleReception(number, received))
        sampled = received
        if received - self._hull[0].received >= constants.CLOCK_KNOWN_S:
            sampled = min(received, self._line(number))
        if received - sampled < self._cycle / 2:
            self._prompt = received
        elif received - self._prompt > constants.PROMPT_TIMEOUT_S:
            self._begin()
            sampled = received
        self._last = min(
            received, max(sampled, self._last + constants.LEAST_INTERVAL_CYCLES * self._cycle)
        )
        return self._last

    def _begin(self) -> None:
        self._hull: list[CycleReception] = []
        self._prompt = -math.inf  # reception of the last frame without delay

    def _extend(self, new: CycleReception) -> None:
        """Add a point to the hull, whose edges become steeper from left to right."""
        hull = self._hull
        while len(hull) > 1 and _slope(hull[-2], new) <= _slope(hull[-2], hull[-1]):
            hull.pop()
        hull.append(new)
        while (
            len(hull) > 1
            and new.received - hull[0].received > constants.CLOCK_WINDOW_S
            and hull[1].received < new.received - constants.CLOCK_KNOWN_S
        ):
            hull.pop(0)

    def _line(self, number: int) -> float:
        """The edge below the middle of the window, prolonged to `number`."""
        middle = (self._hull[0].number + self._hull[-1].number) / 2
        right = next(i for i, point in enumerate(self._hull) if point.number >= middle)
        left = self._hull[right - 1]
        return left.received + _slope(left, self._hull[right]) * (number - left.number)


def _slope(left: CycleReception, right: CycleReception) -> float:
    return (right.received - left.received) / (right.number - left.number)
