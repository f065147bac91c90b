"""Checks of clocks, sampling and encoder positions."""

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
from crane_identification.recording_check import limits
from crane_identification.recording_check.suspicion import Suspicion
from crane_identification.signals.motion import encoder_resolution
from crane_model.machine import Machine


class Lag(NamedTuple):
    """When messages are received after their stamps: `offset` [s] in the middle, `drift` [s/s]."""

    origin: str
    offset: float
    drift: float
    seconds: float  # that the topic was recorded

    @property
    def drifts(self) -> bool:
        return (
            abs(self.drift) > limits.DRIFT and abs(self.drift) * self.seconds > limits.LEAST_DRIFT
        )


def clocks(log: Log) -> Iterator[Suspicion]:
    """Find faults in the stamps of a bag's topics.

    A topic may be received late, but not later and later: a drift comes from the clocks.
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
        elif abs(apart.offset) > limits.OFFSET:
            side = "later" if apart.offset > 0.0 else "earlier"
            yield Suspicion(
                apart.origin,
                f"received {abs(apart.offset):.3f} s {side} than its stamps say {against}",
                "one of the two is sent late, which is harmless, or stamped by another clock",
            )


def _set_back(log: Log) -> Iterator[Suspicion]:
    signals = (log.position, log.force, log.pressure_a, log.command)
    found = {signal.origin: signal.set_back for signal in signals if signal and signal.set_back}
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
    if signal.received is None or len(signal.time) < limits.FEWEST_MESSAGES:
        return None
    time, late = signal.time, signal.received - signal.time
    # the first of the messages of each part is late by the clocks alone, others by queues too
    parts = np.array_split(np.arange(len(time)), limits.FEWEST_MESSAGES)
    quick = np.array([part[late[part].argmin()] for part in parts])
    # the median of slopes (Theil and Sen): one wrong time of the recorder does not tilt it
    first, second = np.triu_indices(len(quick), 1)
    between = time[quick][second] - time[quick][first]
    rise = late[quick][second] - late[quick][first]
    drift = float(np.median(rise[between > 0.0] / between[between > 0.0]))
    return Lag(signal.origin, float(np.median(late)), drift, float(time[-1] - time[0]))


# How often signals were sampled, where samples are missing, and whether old ones were repeated.


def missing(log: Log) -> Iterator[Suspicion]:
    """Samples that are not there: too few, gaps, and signals without a common time."""
    needed = (log.position, log.force, log.pressure_a, log.pressure_b)
    signals = {signal.origin: signal for signal in needed if signal}
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
    begin = max(signal.time[0] for signal in signals.values())
    end = min(signal.time[-1] for signal in signals.values())
    whole = log.position.time[-1] - log.position.time[0]
    if end - begin < limits.TOGETHER * whole:
        times = (f"{o} from {s.time[0]:.1f} s to {s.time[-1]:.1f} s" for o, s in signals.items())
        yield Suspicion(
            "common time",
            ", ".join(times),
            "only a part was recorded of everything"
            if end > begin
            else "positions and forces were never recorded together",
            decisive=bool(end <= begin),
        )


def _gaps(signal: Signal) -> Iterator[Suspicion]:
    found = interruptions(signal)
    if not found:
        return
    longest = max(found, key=lambda gap: gap.length)
    evidence = f"nothing for {longest.length:.3g} s from {longest.begin:.4g} s on"
    if len(found) > 1:
        evidence = (
            f"{len(found)} gaps, {sum(gap.length for gap in found):.3g} s in all; the longest: "
            f"{evidence}, the first from {found[0].begin:.4g} s on"
        )
    yield Suspicion(
        signal.origin,
        evidence,
        f"samples are missing; its {len(found) + 1} parts are used one by one",
    )


def sampling(log: Log) -> Iterator[Suspicion]:
    """Find faults in the rates of a crane's signals."""
    force = log.force or log.pressure_a
    for signal in (log.position, force):
        if signal is not None and (rate := sampling_rate(signal.time)) < limits.SLOWEST:
            yield Suspicion(
                signal.origin,
                f"{rate:.3g} samples a second, at least {limits.SLOWEST:g} needed",
                "too slow for accelerations and for the swinging of the crane; record faster",
                decisive=rate < limits.LEAST_RATE,
            )
    yield from _held(log.position, log.joints)


def _held(signal: Signal, joints: tuple[str, ...]) -> Iterator[Suspicion]:
    """Positions that stand still for some samples, and then jump."""
    rate = sampling_rate(signal.time)
    span = max(1, round(limits.SPEED_OVER * rate))
    resolution = encoder_resolution(signal.value[np.isfinite(signal.value).all(axis=1)])
    for joint, value, step in zip(joints, signal.value.T, resolution, strict=True):
        travel = np.abs(value[2 * span :] - value[: -2 * span]) / (2 * span)  # a sample
        moves = travel > limits.REPEATED_COUNTS * step
        repeated = (np.diff(value) == 0.0)[span : span + len(moves)][moves]
        if len(repeated) > span and repeated.mean() > limits.HELD:
            fresh = rate * (1.0 - repeated.mean())
            yield Suspicion(
                spoken(joint),
                f"{repeated.mean():.0%} of the positions in motion repeat the one before",
                f"measured {fresh:.0f} times a second, and sent again {rate:.0f} times",
                decisive=fresh < limits.SLOWEST,
            )


# Positions against Table 2: units, turns of an encoder, signs, exchanged names, speeds.


def positions(machine: Machine, log: Log) -> Iterator[Suspicion]:
    """Find faults in the encoders of the machine's joints."""
    ranges = {}
    for joint, column in zip(log.joints, log.position.value.T, strict=True):
        if joint in machine.limits:
            time, value = log.position.time, column
            known = np.isfinite(value)
            ranges[joint] = _range(value[known])
            yield from _steps(machine, joint, value[known])
            if _fits(machine, joint, ranges[joint]):
                yield from _speed(machine, joint, time[known], value[known])
    for joint in ranges:
        yield from _outside(machine, joint, ranges)


def _range(value: np.ndarray) -> np.ndarray:
    return np.percentile(value, limits.ALMOST_ALL)


def _fits(machine: Machine, joint: str, values: np.ndarray) -> bool:
    """Return whether the lowest and highest of `values` lie within Table 2."""
    allowed = machine.limits[joint]
    margin = limits.OUTSIDE * (allowed.position_max - allowed.position_min)
    return bool(
        allowed.position_min - margin <= values.min()
        and values.max() <= allowed.position_max + margin
    )


def _outside(machine: Machine, joint: str, ranges: dict[str, np.ndarray]) -> Iterator[Suspicion]:
    seen, unit = ranges[joint], machine.units[joint]
    if _fits(machine, joint, seen):
        return
    allowed = machine.limits[joint]
    evidence = (
        f"from {seen[0]:.4g} to {seen[1]:.4g} {unit}, but the machine file allows "
        f"{allowed.position_min:g} to {allowed.position_max:g} {unit}"
    )
    causes = list(_explanations(machine, joint, ranges))
    cause = " or ".join(causes) or "the zero of the encoder, or the machine file, is wrong"
    yield Suspicion(spoken(joint), evidence, cause, decisive=bool(causes))


def _explanations(machine: Machine, joint: str, ranges: dict[str, np.ndarray]) -> Iterator[str]:
    """Which simple mistakes put the positions where they are."""
    seen, angle = ranges[joint], machine.units[joint] == "rad"
    for neighbour, there in ranges.items():
        mutual = _fits(machine, neighbour, seen) and _fits(machine, joint, there)
        if neighbour != joint and mutual:
            yield f"exchanged names: they fit the {spoken(neighbour)}, whose positions fit here"
    if angle:
        for turns in (sign * n for n in range(1, limits.MOST_TURNS + 1) for sign in (1, -1)):
            if _fits(machine, joint, seen - turns * limits.TURN):
                yield f"the encoder is off by {turns:+d} turn{'s' * (abs(turns) > 1)}"
    if _fits(machine, joint, -seen):
        yield "the sign is reversed"
    allowed = machine.limits[joint]
    least = limits.VISIBLE * (allowed.position_max - allowed.position_min)
    for unit, factor in (limits.UNITS_OF_ANGLE if angle else limits.UNITS_OF_LENGTH).items():
        if _fits(machine, joint, factor * seen) and factor * np.ptp(seen) > least:
            yield f"positions look like {unit}"


def _speed(
    machine: Machine, joint: str, time: np.ndarray, value: np.ndarray
) -> Iterator[Suspicion]:
    allowed, unit = machine.limits[joint], machine.units[joint]
    begin = np.searchsorted(time, time - limits.SPEED_OVER)
    passed = time - time[begin]
    speed = (value - value[begin])[passed > 0.5 * limits.SPEED_OVER] / passed[
        passed > 0.5 * limits.SPEED_OVER
    ]
    if not len(speed):
        return
    down, up = _range(speed)
    over = max(up / allowed.velocity_max, down / allowed.velocity_min)
    if over > limits.TOO_FAST:
        yield Suspicion(
            spoken(joint),
            f"speeds from {down:.3g} to {up:.3g} {unit}/s, but the machine file allows "
            f"{allowed.velocity_min:g} to {allowed.velocity_max:g} {unit}/s",
            "positions or times have another unit, or the machine file is of another machine",
        )


def _steps(machine: Machine, joint: str, value: np.ndarray) -> Iterator[Suspicion]:
    step = float(encoder_resolution(value[:, np.newaxis])[0])
    width = float(np.ptp(value))
    if 0.0 < width < limits.COARSE * step:
        yield Suspicion(
            spoken(joint),
            f"its whole motion of {width:.3g} {machine.units[joint]} is {width / step:.0f} steps "
            "of the encoder",
            "the encoder is too coarse for this motion, or positions were rounded",
        )
