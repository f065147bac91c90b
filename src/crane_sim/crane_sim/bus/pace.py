"""Keeping real time, and saying when it is not kept."""

REPORT = 1.0  # s, at least between two reports
BACKLOG = 10  # cycles, that are run one upon the other after a delay


class PlantPace:
    """Cycles of `period` [s] from `start` [s, steady] on.

    After a delay up to `BACKLOG` cycles are made up for, each at once; after a longer one all that
    fell into it are left out: late frames are of no use, and a burst of them looks like a fault.
    """

    def __init__(self, period: float, start: float):
        self._period = period
        self.due = start + period  # s, steady, when the next cycle is
        self._reported = start
        self.cycles = self.left_out = 0
        self.longest = 0.0  # s, delay
        self._new = 0  # left out since the last report
        self._new_longest = 0.0

    def pause(self, now: float) -> float:
        """Time until the next cycle [s]; 0 where it is overdue."""
        return max(0.0, self.due - now)

    def next(self, now: float) -> str | None:
        """End a cycle at `now`; what is to be reported, if anything."""
        self.cycles += 1
        self.due += self._period
        delay = now - self.due
        self.longest = max(self.longest, delay)
        if delay > BACKLOG * self._period:
            missed = int(delay / self._period) + 1
            self.due += missed * self._period
            self.left_out += missed
            self._new += missed
            self._new_longest = max(self._new_longest, delay)
        if not self._new or now - self._reported < REPORT:
            return None
        report = (
            f"not in real time: {self._new} cycles of {self._period * 1e3:g} ms left out, longest "
            f"delay {self._new_longest * 1e3:.0f} ms; the machine is too slow or too busy"
        )
        self._reported, self._new, self._new_longest = now, 0, 0.0
        return report

    def summary(self, lost: float) -> str:
        """How it went; `lost` [s] is time in which the plant stood still."""
        total = self.cycles + self.left_out
        return (
            f"{self.cycles} cycles, {self.left_out} of {total} left out, longest delay "
            f"{self.longest * 1e3:.0f} ms, {lost:.2f} s lost"
        )
