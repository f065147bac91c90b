"""The pace of the simulated crane: real time, or lock-step with its driver."""

import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

from crane_bags.clocks import NANOSECONDS
from crane_driver.can.bus import BusError
from crane_driver.can.frame import Frame
from crane_driver.can.link import Link
from crane_driver.can.simulated_time import START_NS, STEP, told_time
from crane_nodes.scheduling import PATIENCE_S

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


REPEAT_S = 0.1  # of real time, after which the frames of a cycle are sent again
REMARK_S = 5.0  # of real time, for which the driver is waited for without a word


def send(link: Link, frames: Sequence[Frame]) -> None:
    """Send what can be sent: the link reports a lost bus, and reopens it."""
    for frame in frames:
        with suppress(BusError):
            link.send(frame)


class LockStep:
    """Cycles of `period` [s] on simulated time, each begun when the driver has answered the last.

    A driver that has answered before and does not for `PATIENCE_S` is taken to be dead: time goes
    on as in reality, and the valves close as they do when commands stop.
    """

    def __init__(self, link: Link, woken: threading.Event, period: float):
        """`link` sets `woken` at each answer of the driver."""
        self._link, self._woken, self._period = link, woken, round(period * NANOSECONDS)
        self._begun = time.monotonic()
        self._driven = False  # whether there is a driver, as far as it is known
        self._dead = False
        self.time = START_NS  # of the cycle [ns]
        self.answer: list[Frame] = []  # frames that came for it

    @property
    def after(self) -> float:
        """Time of the next cycle [s]."""
        return (self.time + self._period) / NANOSECONDS

    def wait(self, stop: threading.Event, sent: Sequence[Frame]) -> None:
        """Wait until the driver has answered the cycle, and begin the next one.

        Meanwhile the frames that were `sent` are repeated for a driver that has just begun.
        """
        begun, remarked = time.monotonic(), False
        frames: list[Frame] = []
        while not stop.is_set():
            self._woken.wait(self._period / NANOSECONDS if self._dead else REPEAT_S)
            self._woken.clear()
            new = self._link.take()
            frames += new
            if answers := {told_time(frame, STEP) for frame in new} - {None}:
                self._driven, self._dead, begun = True, False, time.monotonic()  # it is there
            if self.time in answers:
                break
            waited = time.monotonic() - begun
            if self._dead or (self._driven and waited > PATIENCE_S):
                self._dead = True
                break
            if waited > REMARK_S and not (remarked or self._driven):
                remarked = True
                print("waiting for a driver with use_sim_time:=true", file=sys.stderr, flush=True)
            send(self._link, sent)
        now = self.time / NANOSECONDS
        self.answer = [one._replace(stamp=self.time, steady=now) for one in frames]
        self.time += self._period

    @property
    def summary(self) -> str:
        """How fast it went."""
        simulated = (self.time - START_NS) / NANOSECONDS
        real = time.monotonic() - self._begun
        return f"{simulated:.1f} s of simulated time in {real:.1f} s"
