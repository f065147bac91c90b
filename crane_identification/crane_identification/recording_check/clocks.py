"""Clocks of topics: header stamps against the recorder's clock, and topics against each other."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log, Signal
from crane_identification.recording_check.constants import DRIFT, LEAST_DRIFT, OFFSET
from crane_identification.recording_check.suspicion import Suspicion

FEWEST = 20  # messages


class Lag(NamedTuple):
    """When messages are received after their stamps: `offset` [s] in the middle, `drift` [s/s]."""

    origin: str
    offset: float
    drift: float
    seconds: float  # that the topic was recorded

    @property
    def drifts(self) -> bool:
        """Whether the clocks run apart."""
        return abs(self.drift) > DRIFT and abs(self.drift) * self.seconds > LEAST_DRIFT


def clocks(log: Log) -> Iterator[Suspicion]:
    """What is suspicious of the stamps of a bag's topics.

    A topic may be received late, but not later and later: a drift is one of clocks.
    """
    yield from _set_back(log)
    states = _lag(log.position)
    if states is None:
        return
    if states.drifts:
        yield Suspicion(
            states.origin,
            f"stamps drift by {states.drift:+.2%} against the clock of the recorder",
            "the clock that stamps is wrong, or the bag was recorded from one played at another "
            "rate; velocities are wrong by as much",
            decisive=False,
        )
    for signal in (log.pressure_a, log.force, log.command):
        lag = signal and _lag(signal)
        if not lag or lag.origin == states.origin:
            continue
        apart = Lag(lag.origin, lag.offset - states.offset, lag.drift - states.drift, lag.seconds)
        against = f"against {states.origin}, by the clock of the recorder"
        if apart.drifts:
            yield Suspicion(
                apart.origin,
                f"stamps drift by {apart.drift:+.2%} {against}",
                "the two topics are stamped by different clocks; stamp them by one",
                decisive=signal is not log.command,
            )
        elif abs(apart.offset) > OFFSET:
            side = "later" if apart.offset > 0.0 else "earlier"
            yield Suspicion(
                apart.origin,
                f"received {abs(apart.offset):.3f} s {side} than its stamps say {against}",
                "one of the two is sent late, which does no harm, or stamped by another clock",
                decisive=False,
            )


def _set_back(log: Log) -> Iterator[Suspicion]:
    signals = (log.position, log.force, log.pressure_a, log.command)
    found = {one.origin: one.set_back for one in signals if one and one.set_back}
    for origin, back in found.items():
        yield Suspicion(
            origin,
            f"{back}; {back.share:.2%} of its messages are older than one before them",
            "the clock was set back while it was recorded, and samples of two moments are mixed"
            if back.logged
            else "messages overtook one another, or the clock that stamps was set back",
            decisive=back.spoils,
        )


def _lag(signal: Signal) -> Lag | None:
    if signal.received is None or len(signal.time) < FEWEST:
        return None
    time, late = signal.time, signal.received - signal.time
    middle = 0.5 * (time[0] + time[-1])
    # the first of the messages of each part is late by the clocks alone, others by queues too
    parts = np.array_split(np.arange(len(time)), FEWEST)
    quick = np.array([part[late[part].argmin()] for part in parts])
    drift = float(np.polyfit(time[quick] - middle, late[quick], 1)[0])
    return Lag(signal.origin, float(np.median(late)), drift, float(time[-1] - time[0]))
