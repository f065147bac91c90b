"""Positions against Table 2: units, turns of an encoder, signs, exchanged names, speeds."""

from collections.abc import Iterator

import numpy as np

from crane_identification.data.log import Log
from crane_identification.notation import spoken
from crane_identification.recording_check.suspicion import (
    ALMOST_ALL,
    COARSE,
    OUTSIDE,
    SPEED_OVER,
    TOO_FAST,
    TURN,
    UNITS_OF_ANGLE,
    UNITS_OF_LENGTH,
    VISIBLE,
    Suspicion,
)
from crane_identification.signals.motion import encoder_resolution
from crane_model.machine import Machine

LARGEST_TURN = 3  # turns that an encoder may be off


def positions(machine: Machine, log: Log) -> Iterator[Suspicion]:
    """What is suspicious of the encoders of the machine's joints."""
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
    return np.percentile(value, ALMOST_ALL)


def _fits(machine: Machine, joint: str, values: np.ndarray) -> bool:
    """Whether lowest and highest of `values` lie within Table 2."""
    limits = machine.limits[joint]
    margin = OUTSIDE * (limits.position_max - limits.position_min)
    return bool(
        limits.position_min - margin <= values.min()
        and values.max() <= limits.position_max + margin
    )


def _outside(machine: Machine, joint: str, ranges: dict[str, np.ndarray]) -> Iterator[Suspicion]:
    seen, unit = ranges[joint], machine.units[joint]
    if _fits(machine, joint, seen):
        return
    limits = machine.limits[joint]
    evidence = (
        f"from {seen[0]:.4g} to {seen[1]:.4g} {unit}, but the machine file allows "
        f"{limits.position_min:g} to {limits.position_max:g} {unit}"
    )
    causes = list(_explanations(machine, joint, ranges))
    cause = " or ".join(causes) or "the zero of the encoder, or the machine file, is wrong"
    yield Suspicion(spoken(joint), evidence, cause, decisive=bool(causes))


def _explanations(machine: Machine, joint: str, ranges: dict[str, np.ndarray]) -> Iterator[str]:
    """Which simple mistakes put the positions where they are."""
    seen, angle = ranges[joint], machine.units[joint] == "rad"
    for other, there in ranges.items():
        mutual = _fits(machine, other, seen) and _fits(machine, joint, there)
        if other != joint and mutual:
            yield f"exchanged names: they fit the {spoken(other)}, whose positions fit here"
    if angle:
        for turns in (sign * n for n in range(1, LARGEST_TURN + 1) for sign in (1, -1)):
            if _fits(machine, joint, seen - turns * TURN):
                yield f"the encoder is off by {turns:+d} turn{'s' * (abs(turns) > 1)}"
    if _fits(machine, joint, -seen):
        yield "the sign is turned"
    limits = machine.limits[joint]
    least = VISIBLE * (limits.position_max - limits.position_min)
    for unit, factor in (UNITS_OF_ANGLE if angle else UNITS_OF_LENGTH).items():
        if _fits(machine, joint, factor * seen) and factor * np.ptp(seen) > least:
            yield f"positions look like {unit}"


def _speed(
    machine: Machine, joint: str, time: np.ndarray, value: np.ndarray
) -> Iterator[Suspicion]:
    limits, unit = machine.limits[joint], machine.units[joint]
    begin = np.searchsorted(time, time - SPEED_OVER)
    passed = time - time[begin]
    speed = (value - value[begin])[passed > 0.5 * SPEED_OVER] / passed[passed > 0.5 * SPEED_OVER]
    if not len(speed):
        return
    down, up = _range(speed)
    over = max(up / limits.velocity_max, down / limits.velocity_min)
    if over > TOO_FAST:
        yield Suspicion(
            spoken(joint),
            f"speeds from {down:.3g} to {up:.3g} {unit}/s, but the machine file allows "
            f"{limits.velocity_min:g} to {limits.velocity_max:g} {unit}/s",
            "positions or times have another unit, or the machine file is of another machine",
            decisive=False,
        )


def _steps(machine: Machine, joint: str, value: np.ndarray) -> Iterator[Suspicion]:
    step = float(encoder_resolution(value[:, np.newaxis])[0])
    width = float(np.ptp(value))
    if 0.0 < width < COARSE * step:
        yield Suspicion(
            spoken(joint),
            f"its whole motion of {width:.3g} {machine.units[joint]} is {width / step:.0f} steps "
            "of the encoder",
            "the encoder is too coarse for this motion, or positions were rounded",
            decisive=False,
        )
