"""When a device took its readings, from when their frames were received."""

import math

WINDOW = 10.0  # s over which the clock of a device is followed
LEARNT = 1.0  # s after which it is relied on
PROMPT_TIMEOUT_S = 1.0  # in which one frame comes without delay, or the clock has changed
LEAST = 0.1  # cycles between two instants of sampling
Cycle = tuple[int, float]  # number, reception [s, steady]


class SamplingClock:
    """The even clock by which a device samples, seen through receptions that are late at times.

    A frame is never early: over the number of its cycle, receptions lie on or above the straight
    line of the device's clock, and the frames without delay lie on it. That line is the edge of the
    lower convex hull of the last receptions below their middle, which follows any drift of the two
    clocks. Source: Zhang, Liu, Xia, Clock synchronization algorithms for network measurements,
    IEEE INFOCOM 2002.
    """

    def __init__(self, cycle: float):
        """cycle: nominal, [s]."""
        self._cycle = cycle
        self._last = -math.inf
        self._begin()

    def sampled(self, number: int, received: float) -> float:
        """When cycle `number` was sampled [s, steady], but for the delay that all frames have.

        Numbers and receptions [s, steady] increase from call to call. Never later than `received`,
        and the same as long as the clock is not known.
        """
        self._extend((number, received))
        sampled = received
        if received - self._hull[0][1] >= LEARNT:
            sampled = min(received, self._line(number))
        if received - sampled < self._cycle / 2:
            self._prompt = received
        elif received - self._prompt > PROMPT_TIMEOUT_S:
            self._begin()
            sampled = received
        self._last = min(received, max(sampled, self._last + LEAST * self._cycle))
        return self._last

    def _begin(self) -> None:
        self._hull: list[Cycle] = []
        self._prompt = -math.inf  # reception of the last frame without delay

    def _extend(self, new: Cycle) -> None:
        """Add a point to the hull, whose edges become steeper from left to right."""
        hull = self._hull
        while len(hull) > 1 and _slope(hull[-2], new) <= _slope(hull[-2], hull[-1]):
            hull.pop()
        hull.append(new)
        while len(hull) > 1 and new[1] - hull[0][1] > WINDOW and hull[1][1] < new[1] - LEARNT:
            hull.pop(0)

    def _line(self, number: int) -> float:
        """The edge below the middle of the window, prolonged to `number`."""
        middle = (self._hull[0][0] + self._hull[-1][0]) / 2
        right = next(i for i, point in enumerate(self._hull) if point[0] >= middle)
        left = self._hull[right - 1]
        return left[1] + _slope(left, self._hull[right]) * (number - left[0])


def _slope(left: Cycle, right: Cycle) -> float:
    """Seconds a cycle."""
    return (right[1] - left[1]) / (right[0] - left[0])
