"""The last seconds of the live signals, as a log that can be checked like a recording."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from crane_bags.clocks import NANOSECONDS, TimeBack
from crane_identification.data.log import Log, Signal
from crane_identification.online.estimator import Forces, OnlineEstimator
from crane_identification.recording_check.check import check
from crane_identification.recording_check.suspicion import Checked
from crane_model.machine import Machine

CHECK_WINDOW_S = 30.0  # s, in which a crane that is excited moves every joint both ways
LEAST_WINDOW_S = 20.0  # s of both topics, before which nothing is said
# S from check to check, each of which takes 0.03 to 0.2 s of the node's thread
CHECK_PERIOD_S = 10.0


class Recent:
    """Positions and pressures of the last `CHECK_WINDOW_S`, each with its stamps [ns]."""

    def __init__(self, machine: Machine | None, joints: Sequence[str]):
        self._machine, self._joints = machine, tuple(joints)
        self._positions: deque[tuple[int, np.ndarray]] = deque()
        self._pressures: deque[tuple[int, np.ndarray]] = deque()
        self._checked = 0  # ns
        self.found: Checked | None = None

    def add_position(self, stamp: int, position: np.ndarray) -> None:
        _keep(self._positions, stamp, position)

    def add_pressure(self, stamp: int, chamber_a: np.ndarray, chamber_b: np.ndarray) -> None:
        _keep(self._pressures, stamp, np.concatenate([chamber_a, chamber_b]))

    def forget(self) -> None:
        self._positions.clear()
        self._pressures.clear()
        self._checked, self.found = 0, None

    def check(self) -> None:
        """Look at what is there, if enough of it is new; `found` holds the result."""
        seconds = [
            (queue[-1][0] - queue[0][0]) / NANOSECONDS if queue else 0.0
            for queue in (self._positions, self._pressures)
        ]
        if min(seconds) < LEAST_WINDOW_S:
            return
        newest = self._positions[-1][0]
        if 0 <= newest - self._checked < CHECK_PERIOD_S * NANOSECONDS:
            return
        self._checked, self.found = newest, check(self._machine, self._log())

    def _log(self) -> Log:
        start = self._positions[0][0]
        pressure = _signal(self._pressures, start, "pressures")
        chamber_a, chamber_b = np.split(pressure.value, 2, axis=1)
        return Log(
            source=f"the last {CHECK_WINDOW_S:g} s",
            joints=self._joints,
            start=start,
            position=_signal(self._positions, start, "positions"),
            pressure_a=Signal(pressure.time, chamber_a, pressure.origin),
            pressure_b=Signal(pressure.time, chamber_b, pressure.origin),
        )


class Watched:
    """An estimator whose readings are kept for the check, too.

    If the stamps of a stream go back, both begin anew: the same data would count twice. What the
    other stream measured before that is left out.
    """

    def __init__(self, estimator: OnlineEstimator, recent: Recent):
        self._estimator, self._recent = estimator, recent
        self.back = TimeBack()
        self.model, self.options = estimator.model, estimator.options

    def add_position(self, stamp: int, position: np.ndarray) -> list[Forces]:
        if not self._counts("positions", stamp):
            return []
        self._recent.add_position(stamp, position)
        return self._estimator.add_position(stamp, position)

    def add_pressure(
        self, stamp: int, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> list[Forces]:
        if not self._counts("pressures", stamp):
            return []
        self._recent.add_pressure(stamp, chamber_a, chamber_b)
        return self._estimator.add_pressure(stamp, chamber_a, chamber_b)

    def _counts(self, stream: str, stamp: int) -> bool:
        if self.back.lags(stream, stamp):
            return False
        if self.back.comes(stream, stamp):
            self._recent.forget()
            self._estimator.reset()
        return True


def _keep(queue: deque[tuple[int, np.ndarray]], stamp: int, values: np.ndarray) -> None:
    """Add what is newer than the rest, drop what is too old; a clock set back begins anew."""
    if queue and stamp <= queue[-1][0]:
        if queue[-1][0] - stamp < NANOSECONDS:
            return
        queue.clear()
    queue.append((stamp, values))
    while stamp - queue[0][0] > CHECK_WINDOW_S * NANOSECONDS:
        queue.popleft()


def _signal(queue: deque[tuple[int, np.ndarray]], start: int, origin: str) -> Signal:
    stamps = np.array([stamp for stamp, _ in queue])
    return Signal((stamps - start) / NANOSECONDS, np.array([values for _, values in queue]), origin)
