"""Checks of stamps: clocks of topics, and how often signals were sampled."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import (
    LARGEST_GAP,
    SHORTEST_RUN,
    interruptions,
    sampling_rate,
)
from crane_identification.notation import spoken
from crane_identification.recording_check.suspicion import (
    DRIFT,
    HELD,
    HELD_COUNTS,
    LEAST_DRIFT,
    LEAST_RATE,
    OFFSET,
    SLOWEST,
    SPEED_OVER,
    TOGETHER,
    Suspicion,
)
from crane_identification.signals.motion import encoder_resolution

# Clocks of topics: header stamps against the recorder's clock, and topics against each other.

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


# How often signals were sampled, where samples are missing, and whether old ones were repeated.


def missing(log: Log) -> Iterator[Suspicion]:
    """Samples that are not there: too few, gaps, and signals without a common time."""
    signals = {one.origin: one for one in _needed(log)}
    for origin, signal in signals.items():
        complete = np.isfinite(signal.value).all(axis=1)
        if (count := int(complete.sum())) < SHORTEST_RUN:
            yield Suspicion(
                origin,
                f"{count} samples that hold a number for each joint, at least {SHORTEST_RUN} "
                "needed",
                "nothing can be fitted to it; check the sensors and their stamps",
                decisive=True,
            )
            return
        if np.median(np.diff(signal.time)) < LARGEST_GAP:
            yield from _gaps(signal)
    begin = max(one.time[0] for one in signals.values())
    end = min(one.time[-1] for one in signals.values())
    whole = log.position.time[-1] - log.position.time[0]
    if end - begin < TOGETHER * whole:
        times = (f"{o} from {s.time[0]:.1f} s to {s.time[-1]:.1f} s" for o, s in signals.items())
        yield Suspicion(
            "common time",
            ", ".join(times),
            "only a part was recorded of everything"
            if end > begin
            else "positions and forces were never recorded together",
            decisive=bool(end <= begin),
        )


def _needed(log: Log) -> list[Signal]:
    return [one for one in (log.position, log.force, log.pressure_a, log.pressure_b) if one]


def _gaps(signal: Signal) -> Iterator[Suspicion]:
    found = interruptions(signal)
    if not len(found):
        return
    begin, length = found[found[:, 1].argmax()]
    evidence = f"nothing for {length:.3g} s from {begin:.4g} s on"
    if len(found) > 1:
        evidence = (
            f"{len(found)} gaps, {found[:, 1].sum():.3g} s in all; the longest: {evidence}, the "
            f"first from {found[0, 0]:.4g} s on"
        )
    yield Suspicion(
        signal.origin,
        evidence,
        f"samples are missing; its {len(found) + 1} parts are used one by one",
        decisive=False,
    )


def sampling(log: Log) -> Iterator[Suspicion]:
    """What is suspicious of the rates of a crane's signals."""
    force = log.force or log.pressure_a
    for signal in (log.position, force):
        if signal is not None and (rate := sampling_rate(signal.time)) < SLOWEST:
            yield Suspicion(
                signal.origin,
                f"{rate:.3g} samples a second, at least {SLOWEST:g} needed",
                "too slow for accelerations and for the swinging of the crane; record faster",
                decisive=rate < LEAST_RATE,
            )
    yield from _held(log.position, log.joints)


def _held(signal: Signal, joints: tuple[str, ...]) -> Iterator[Suspicion]:
    """Positions that stand still for some samples, and then jump."""
    rate = sampling_rate(signal.time)
    span = max(1, round(SPEED_OVER * rate))
    resolution = encoder_resolution(signal.value[np.isfinite(signal.value).all(axis=1)])
    for joint, value, step in zip(joints, signal.value.T, resolution, strict=True):
        travel = np.abs(value[2 * span :] - value[: -2 * span]) / (2 * span)  # a sample
        moves = travel > HELD_COUNTS * step
        repeated = (np.diff(value) == 0.0)[span : span + len(moves)][moves]
        if len(repeated) > span and repeated.mean() > HELD:
            fresh = rate * (1.0 - repeated.mean())
            yield Suspicion(
                spoken(joint),
                f"{repeated.mean():.0%} of the positions in motion repeat the one before",
                f"measured {fresh:.0f} times a second, and sent again {rate:.0f} times",
                decisive=fresh < SLOWEST,
            )
