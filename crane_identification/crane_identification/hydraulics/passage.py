"""A joint's recording, cut to where all is known that the balance of its flow needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import LARGEST_GAP, sampling_rate
from crane_identification.signals.motion import encoder_resolution
from crane_model.cylinders import cylinder_length, lever_arm
from crane_model.errors import DataError
from crane_model.machine import Machine

# The course of a joint between the counts of its encoder.


def between_counts(time: np.ndarray, reading: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Positions (m,) at the times `at` (m,), in counts, from readings (n,) of counts at `time`.

    While a joint creeps its reading stands, and then changes by a whole count, which is no motion
    of a whole count: when it changes, the joint is halfway. So these crossings are joined by lines,
    with the readings that differ from those before and behind.
    """
    stands = np.abs(np.diff(reading)) < 0.5
    beside = np.pad(stands, 1)  # (n + 1,) before and behind each reading
    lone = ~(beside[:-1] | beside[1:])
    lone[[0, -1]] = True
    crossing = ~stands & (beside[:-2] | beside[2:])
    times = np.concatenate([time[lone], 0.5 * (time[:-1] + time[1:])[crossing]])
    places = np.concatenate([reading[lone], 0.5 * (reading[:-1] + reading[1:])[crossing]])
    order = np.argsort(times)
    return np.interp(at, times[order], places[order])


LEAST_RUN = 3.0  # s; of what is shorter, the filter sees little but its ends
LEAST_TIME = 8.0  # s of motion in either direction
STILL = 0.02  # of the fastest piston speed; below it a joint counts as at rest
PRESSURES = ("pressure_a", "pressure_b", "supply_pressure", "tank_pressure")
COMMON = ("supply_pressure", "tank_pressure")  # of all joints; nominal where they are not logged
MOTION = ("position", "command")
SIGNALS = (*MOTION, *PRESSURES)


@dataclass(frozen=True)
class Passage:
    """n samples, `step` [s] apart and without a gap; commands (m,) with stamps of their own.

    `length` of the cylinder [m], as `counts` of the encoder tell it, each of which is `resolution`;
    pressures [Pa]; commands are those of the spool, positive where they let oil into chamber A, and
    reach back to the start of the recording.
    """

    source: str
    step: float
    time: np.ndarray  # (n,) s
    length: np.ndarray  # (n,) m
    counts: np.ndarray  # (n,)
    resolution: np.ndarray  # (n,) m
    pressures: Mapping[str, np.ndarray]  # (n,) Pa each, by their names in a log
    stamps: np.ndarray  # (m,) s
    commands: np.ndarray  # (m,) -1..1

    def __len__(self) -> int:
        return len(self.time)


def passages(machine: Machine, joint: str, logs: Sequence[Log]) -> list[Passage]:
    """All parts of the recordings in which everything is known; of a joint without transducers,
    position and command, and supply and tank pressure where they are logged.

    `DataError` says what was not logged, or that the joint moves too little where all is known.
    """
    where = f"hydraulics of '{joint}'"
    wanted = SIGNALS if machine.cylinders[joint].pressure_sensors else MOTION
    if others := sorted(machine.seen_by(joint).keys() - {joint}):
        raise DataError(
            f"{where}: its actuator moves with {', '.join(others)} as well; valves are identified "
            "of actuators that move one joint"
        )
    lacking = {log.source: _lacking(log, joint, wanted) for log in logs}
    if logs and all(lacking.values()):
        log = logs[0]
        raise DataError(
            f"{where}: {log.source} holds no {', '.join(lacking[log.source])}; record valve "
            "commands, positions, and the pressures of supply, tank and chambers"
        )
    found = [
        part
        for log in logs
        if not lacking[log.source]
        for part in _parts(machine, joint, log, wanted)
    ]
    _require_motion(where, wanted, found, sum(float(np.ptp(log.position.time)) for log in logs))
    return found


def _lacking(log: Log, joint: str, wanted: Sequence[str]) -> list[str]:
    return [name for name in wanted if _column(log, joint, name) is None]


def _column(log: Log, joint: str, name: str) -> Signal | None:
    """The samples of a signal that hold a number for the joint, (k,); None if there are not two."""
    apart = joint not in log.joints and name in ("position", "command")
    signal: Signal | None = getattr(log, f"{joint}_{name}" if apart else name, None)
    if signal is None:
        return None
    value = signal.value if signal.value.ndim == 1 else signal.value[:, log.joints.index(joint)]
    known = np.isfinite(value)
    if np.count_nonzero(known) < 2:
        return None
    return Signal(signal.time[known], value[known], signal.origin)


def _parts(machine: Machine, joint: str, log: Log, wanted: Sequence[str]) -> list[Passage]:
    signals = {name: _column(log, joint, name) for name in (*wanted, *COMMON)}
    given = {name: signal for name, signal in signals.items() if signal is not None}
    step = 1.0 / sampling_rate(given["position"].time)
    begin = max(signal.time[0] for signal in given.values())
    end = min(signal.time[-1] for signal in given.values())
    time = begin + step * np.arange(max(int((end - begin) / step), 0))
    known = np.ones(len(time), dtype=bool)
    for signal in given.values():
        known &= _between_samples(signal.time, time)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
    position, command = given["position"], given["command"]
    sense = float(np.sign(lever_arm(machine, joint, position.value).mean()))
    count = float(encoder_resolution(position.value[:, np.newaxis])[0]) or 1.0  # where it rests
    length = Signal(position.time, cylinder_length(machine, joint, position.value), position.origin)
    nominal = machine.hydraulics.model_dump(include=set(COMMON))
    times = [time[first:last] for first, last in edges if (last - first) * step >= LEAST_RUN]
    return [
        Passage(
            source=log.source,
            step=step,
            time=inside,
            length=_smooth(length, inside),
            counts=between_counts(position.time, position.value / count, inside),
            resolution=count * np.abs(lever_arm(machine, joint, _smooth(position, inside))),
            pressures={name: np.full(len(inside), value) for name, value in nominal.items()}
            | {name: _smooth(given[name], inside) for name in given if name in PRESSURES},
            stamps=command.time,
            commands=sense * command.value,
        )
        for inside in times
    ]


def _between_samples(stamps: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(n,) whether times lie between two stamps that are close enough to tell what was between."""
    longest = max(LARGEST_GAP, 2.0 * float(np.median(np.diff(stamps))))
    after = np.searchsorted(stamps, time).clip(1, len(stamps) - 1)
    return np.asarray(stamps[after] - stamps[after - 1] <= longest)


def _smooth(signal: Signal, time: np.ndarray) -> np.ndarray:
    """At the times (n,), by the cubic spline through the samples at their own stamps."""
    near = slice(
        max(int(np.searchsorted(signal.time, time[0])) - 4, 0),
        int(np.searchsorted(signal.time, time[-1])) + 4,
    )
    return np.asarray(CubicSpline(signal.time[near], signal.value[near])(time))


def _require_motion(
    where: str, wanted: Sequence[str], found: Sequence[Passage], recorded: float
) -> None:
    speeds = [np.gradient(part.length, part.step) for part in found]
    fastest = max((float(np.abs(speed).max()) for speed in speeds), default=0.0)
    out, back = (
        sum(
            float((sign * speed > STILL * fastest).sum()) * part.step
            for part, speed in zip(found, speeds, strict=True)
        )
        for sign in (1.0, -1.0)
    )
    if min(out, back) < LEAST_TIME:
        known = sum(len(part) * part.step for part in found)
        raise DataError(
            f"{where}: its cylinder extends for {out:.0f} s and retracts for {back:.0f} s where "
            f"all is known, {LEAST_TIME:.0f} s each needed; "
            + (
                f"{', '.join(wanted)} are known together for {known:.1f} s of {recorded:.1f} s: "
                "log them all along"
                if known < 0.9 * recorded
                else "record longer, or move it more"
            )
        )
