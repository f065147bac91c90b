"""The frames of one message, told apart by their counter and the time of their reception."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

EARLY = 0.5  # cycles, by which a frame may seem to come before it was sent
PROMPT = 0.25  # cycles after the promptest, within which a frame is prompt as well
OVERTAKEN = 3.0  # cycles, after which no frame comes any more that was sent before
EMPTY_PART_OF_ROUND = 3  # part of a round before prompt frames in which none may come
LEAST_SUPPORT_PART = 8  # part of the frames that must be prompt
LEAST_SUPPORT = 3  # frames
DRIFT = 2e-3  # by which the clock of a device may be slow
SILENCE = 4.0  # cycles, in which a device may have restarted
DOUBTED_FRAMES = 20  # frames in a row without a prompt one, after which it has
TELLING = 30  # frames, from which on they can tell a cycle time
CLEAR_TREND = 4.0  # times the unevenness; a delay that ends halfway makes 2.5
MOST_OFF = 0.25  # of the nominal cycle, by which a device may send faster or slower
PROMPT_AMONG_FRAMES = 200  # frames in a row, in which a clock cannot drift by as much as `EARLY`


class Beat(NamedTuple):
    """When the frames of a message are to come, by prompt ones."""

    base: float  # s, reception of index 0, if it were prompt; an index has the counter's remainder
    received: float  # s, from when on indices are proven
    passed: int  # index that all of these are beyond


def measured_cycle(received: np.ndarray, counters: np.ndarray, cycle: float, count: int) -> float:
    """The cycle time [s] by which a device really sends, where frames (n,) come evenly, none is
    lost, and delays cannot have brought about what they show; else the nominal `cycle`.
    """
    if len(received) < TELLING or ((np.diff(counters) % count) != 1).any():
        return cycle
    index = np.arange(len(received))
    slope, first = np.polyfit(index, received - received[0], 1)
    uneven = np.abs(received - received[0] - first - slope * index).max()
    off = abs(slope / cycle - 1.0)
    clear = CLEAR_TREND * uneven < off * cycle * len(received)
    even = uneven < PROMPT * cycle
    return float(slope) if even and clear and DRIFT < off < MOST_OFF else cycle


def find_beat(received: np.ndarray, counters: np.ndarray, cycle: float, count: int) -> Beat | None:
    """The beat of frames with `counters` (n,) from 0 to count - 1, `received` (n,) [s]; None if
    they show no clear one.

    Prompt frames all come at the same instant of their cycle, in the place of the round that their
    counter says, none comes before, and late frames follow at any time.
    """
    late = (received / cycle - counters) % count  # cycles, from any origin
    ordered = np.sort(late)
    ends = np.searchsorted(np.concatenate([ordered, ordered + count]), ordered + PROMPT)
    support = ends - np.arange(len(ordered))
    best = int(support.argmax())
    before = ordered - np.roll(ordered, 1)
    before[0] += count
    ahead = (ordered[best] - ordered[before >= count / EMPTY_PART_OF_ROUND]) % count
    enough = min(len(late), max(LEAST_SUPPORT, len(late) // LEAST_SUPPORT_PART))
    if support[best] < enough or not len(ahead) or ahead.min() > EARLY:
        return None
    base = ordered[best] * cycle
    late = (late - ordered[best]) % count
    indices = np.round((received - base) / cycle - late)
    # No older one may follow the first that counts: it would be late by a whole round.
    following = np.append(np.minimum.accumulate(indices[::-1])[::-1][1:], math.inf)
    firsts = np.flatnonzero((late < PROMPT) & (following > indices))
    if not len(firsts):
        return None
    first = firsts[0]
    begin, passed = float(received[first]), int(indices[first])
    if first == 0 or begin - received[first - 1] >= OVERTAKEN * cycle:
        return Beat(base, begin, passed - 1)
    return Beat(base, math.nextafter(begin, math.inf), passed)  # others may have overtaken it


class FrameStream:
    """Tells the index of each frame, which is proven where

    - no frame comes more than `OVERTAKEN` after one that was sent later,
    - no frame comes before one that is as prompt as any would, and one of `PROMPT_AMONG_FRAMES` is,
    - a device is silent for longer than `SILENCE` before it counts anew,

    for then it is newer than all that came before, no newer than the time allows, and only one
    index in between has its counter. While these hold, a wrong index cannot be proven but where,
    after a silence, late frames of a new count look like prompt ones of the old.
    """

    def __init__(self, cycle: float, count: int, beat: Beat):
        self.cycle, self.base = cycle, beat.base
        self._count = count
        self._overtaken = min(OVERTAKEN, count // 4) * cycle
        self._passed = self._newest = beat.passed
        self._recent: deque[tuple[float, int]] = deque()  # may still be followed by older ones
        self._received = beat.received
        self._late = 0  # frames since the last prompt one
        self.doubtful = False  # the device may have restarted, until a prompt frame comes
        self.known = True  # when frames are to come

    def silence(self, received: float) -> float:
        """Cycles from the newest frame, had it been prompt, to a reception: the sender was silent
        for no longer.
        """
        return (received - self.base) / self.cycle - self._newest

    def index(self, counter: int, received: float) -> tuple[int, bool]:
        """Of a frame, and whether it is proven; else it may be another by whole rounds."""
        while self._recent and received - self._recent[0][0] >= self._overtaken:
            self._passed = max(self._passed, self._recent.popleft()[1])
        index = self._passed + 1 + (counter - self._passed - 1) % self._count
        late = (received - self.base) / self.cycle - index
        if late < -EARLY:
            self.known, self.doubtful = not self.doubtful, True
            return index - self._count, False
        if late >= self._count - EARLY:
            return index, False
        self._late = 0 if late < EARLY else self._late + 1
        self.doubtful = (self.doubtful or self.silence(received) > SILENCE) and self._late > 0
        self.known = self._late <= (DOUBTED_FRAMES if self.doubtful else PROMPT_AMONG_FRAMES)
        self._newest = max(self._newest, index)
        self._recent.append((received, index))
        self.base = min(
            self.base + DRIFT * (received - self._received), received - index * self.cycle
        )
        self._received = received
        return index, True
