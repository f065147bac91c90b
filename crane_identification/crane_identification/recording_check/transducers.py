"""Checks of pressures and of the transducers that measure them."""

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import sampling_rate
from crane_identification.notation import spoken
from crane_identification.recording_check import limits
from crane_identification.recording_check.suspicion import Suspicion
from crane_identification.signals.motion import encoder_resolution
from crane_model.flow import ATMOSPHERE_PA
from crane_model.machine import Machine

CAUSES = {
    "highest": "clipped at the end of its range",
    "lowest": "an empty chamber, or clipped at the lower end of its range",
    "": "the transducer is stuck",
}
MEGA = 1e6

# Pressures against supply, relief valve, tank and range: units, signs, absolute for gauge.


def pressures(machine: Machine, log: Log) -> Iterator[Suspicion]:
    """Find faults in the transducers of the machine's cylinders, supply and tank."""
    if log.pressure_a is not None and log.pressure_b is not None:
        for j, joint in enumerate(log.joints):
            if joint in machine.cylinders:
                both = [log.pressure_a.value[:, j], log.pressure_b.value[:, j]]
                yield from _cylinder(
                    machine, joint, *(pressure[np.isfinite(pressure)] for pressure in both)
                )
    if log.supply_pressure is not None:
        yield from _supply(machine, log.supply_pressure)
    if log.tank_pressure is not None:
        yield from _tank(machine, log.tank_pressure)


def _cylinder(
    machine: Machine, joint: str, chamber_a: np.ndarray, chamber_b: np.ndarray
) -> Iterator[Suspicion]:
    supply, relief = machine.hydraulics.supply_pressure, machine.hydraulics.relief_pressure
    where = f"pressures of the {spoken(joint)}"
    lowest, highest = (float(np.percentile([*chamber_a, *chamber_b], p)) for p in limits.ALMOST_ALL)
    if lowest < limits.VACUUM:
        turned = (
            "the sign is reversed" if highest < -limits.VACUUM else "the zero or the sign is wrong"
        )
        evidence = f"down to {lowest / MEGA:.4g} MPa, and vacuum is -0.1 MPa"
        yield Suspicion(where, evidence, turned, decisive=True)
    elif highest < limits.FEEBLE * supply:
        evidence = f"at most {highest:.4g} Pa, and the supply has {supply:.4g} Pa"
        unit = _unit(highest, supply)
        cause = f"they look like {unit}" if unit else "the pump was off, or the unit is wrong"
        yield Suspicion(where, evidence, cause, decisive=True)
    else:
        count = min(len(chamber_a), len(chamber_b))
        higher = np.maximum(chamber_a[:count], chamber_b[:count])
        often = float(np.percentile(higher, 100 * (1 - limits.LEAST_OVERPRESSURE_SHARE)))
        if often > limits.FULL[1] * relief:
            yield Suspicion(
                where,
                f"above {often / MEGA:.4g} MPa for {limits.LEAST_OVERPRESSURE_SHARE:.0%} of the "
                f"time, and the relief valve opens at {relief / MEGA:.4g} MPa",
                "they look too large: a wrong unit or range of the transducers, or the relief "
                "valve of the machine file",
                decisive=True,
            )


def _unit(highest: float, supply: float) -> str:
    """The unit in which a cylinder's highest pressure makes sense, or nothing."""
    low, high = limits.FULL
    fits = [
        u
        for u, pa in limits.UNITS_OF_PRESSURE.items()
        if low * supply <= pa * highest <= high * supply
    ]
    return " or ".join(fits)


def _supply(machine: Machine, signal: Signal) -> Iterator[Suspicion]:
    seen, stated = float(np.nanmedian(signal.value)), machine.hydraulics.supply_pressure
    sensing = machine.hydraulics.load_sensing  # follows the loads, from half its margin on
    least = 0.5 * sensing.margin if sensing else limits.SUPPLY[0] * stated
    if not least <= seen <= limits.SUPPLY[1] * stated:
        unit = _unit(seen, stated)
        yield Suspicion(
            "supply pressure",
            f"{seen:.4g} Pa, and the machine file has {stated:.4g} Pa",
            f"it looks like {unit}" if unit else "the transducer or the machine file is wrong",
        )


def _tank(machine: Machine, signal: Signal) -> Iterator[Suspicion]:
    """A tank that has one atmosphere too much: pressures are measured against vacuum."""
    seen, stated = float(np.nanmedian(signal.value)), machine.hydraulics.tank_pressure
    if abs(seen - stated - ATMOSPHERE_PA) < limits.NEAR_ATMOSPHERE:
        yield Suspicion(
            "tank pressure",
            f"{seen / MEGA:.3f} MPa, and the machine file has {stated / MEGA:.3f} MPa",
            "pressures look absolute; gauge is needed: subtract 0.101 MPa from all of them",
        )


# Sensors that stop: transducers that are clipped or stuck, and encoders that are frozen.


class _Column(NamedTuple):
    """Readings (n,) of one transducer that are numbers, at `time` (n,) [s].

    `moves` (n,): whether its joint moves then. `step`: smallest between readings, `steps`: how
    many of them are in the range of the readings.
    """

    where: str
    time: np.ndarray
    value: np.ndarray
    moves: np.ndarray
    step: float
    steps: float


def transducers(log: Log) -> Iterator[Suspicion]:
    """Readings that stay the same while the joint moves; needs neither units nor a machine.

    Readings in coarse steps stay the same by themselves: of these, a plateau is suspicious only
    if the other sensors expect a change there. All pressures show how fine their transducers are:
    a chamber whose pressure hardly changes has few steps, and may have a fine one.
    """
    yield from _encoders(log)
    coarse: dict[str, list[str]] = defaultdict(list)
    pressures = [signal.value for signal in (log.pressure_a, log.pressure_b) if signal]
    finite = [values[np.isfinite(values)] for values in pressures]
    widest = max((float(np.ptp(values)) for values in finite if len(values)), default=0.0)
    for name, signal in (
        ("chamber A", log.pressure_a),
        ("chamber B", log.pressure_b),
        ("force", log.force if log.pressure_a is None else None),
    ):
        if signal is None:
            continue
        for j, joint in enumerate(log.joints):
            known = np.isfinite(signal.value[:, j])
            time, value = signal.time[known], signal.value[known, j]
            if len(value) < 2:
                continue
            step = float(encoder_resolution(value[:, np.newaxis])[0])
            steps = float(np.ptp(value)) / step if step else 0.0
            column = _Column(
                f"{spoken(joint)}, {name}", time, value, _moves(log, j, time), step, steps
            )
            long = _plateaus(column)
            if 0.0 < steps < limits.COARSE_STEPS:
                long &= _unexpected(log, signal, j, column, long)
                if widest < limits.COARSE_STEPS * step:
                    coarse[_size(log, name, step)].append(column.where)
            yield from _still(column, long)
    for size, where in coarse.items():
        yield Suspicion(
            "; ".join(where),
            f"steps of {size}",
            "coarse readings: what is smaller than a step cannot be seen",
        )


def _size(log: Log, name: str, step: float) -> str:
    if log.uncalibrated:
        return f"{step:.4g} counts"
    return f"{step:.4g} N or N m" if name == "force" else f"{step / MEGA:.4g} MPa"


def _encoders(log: Log) -> Iterator[Suspicion]:
    """Encoders that show one reading for a while or always, though the joint moved."""
    for j, joint in enumerate(log.joints):
        known = np.isfinite(log.position.value[:, j])
        time, value = log.position.time[known], log.position.value[known, j]
        if not len(value):
            continue
        if np.ptp(value) > 0.0:
            yield from _halts(log, j, time, value)
            continue
        moved = list(_asked(log, j, time[0], time[-1]))
        evidence = f"one reading, {value[0]:.6g}, from the first sample to the last"
        yield Suspicion(
            spoken(joint),
            f"{evidence}; but {', and '.join(moved)}" if moved else evidence,
            "its encoder is frozen" if moved else "the joint stood still, or its encoder is frozen",
            decisive=bool(moved),
        )


def _halts(log: Log, j: int, time: np.ndarray, value: np.ndarray) -> Iterator[Suspicion]:
    """Find a rest that begins or ends within one step, though a joint has inertia.

    A joint that comes to rest slows down first, and its speed changes more in the steps before the
    rest than at its edge. A frozen encoder stops from full speed, or jumps to where the joint is.
    """
    first = _edges(value)
    last = np.append(first[1:], len(value)) - 1
    rests = time[last] - time[first] > limits.PLATEAU
    if not rests.any():
        return
    first, last = first[rests], last[rests]
    steps = _steps(time, value, first, last)
    change = np.maximum(steps.change[first], steps.change[last])
    worst = int(change.argmax())
    if change[worst] <= steps.most:
        return
    begin, end = time[first[worst]], time[last[worst]]
    moved = list(_asked(log, j, begin, end))
    evidence = [
        f"one reading, {value[first[worst]]:.6g}, from {begin:.4g} s to {end:.4g} s",
        f"at an end of it the speed changes by {change[worst]:.3g} rad/s or m/s within "
        f"{steps.seconds:.2g} s, in motion by {steps.most:.3g} at most",
        *moved,
    ]
    frozen = bool(moved or change[worst] > steps.fastest)
    yield Suspicion(
        spoken(log.joints[j]),
        "; ".join(evidence),
        "its encoder was frozen" if frozen else "its encoder was frozen, or the joint hit a stop",
        decisive=frozen,
    )


class _Steps(NamedTuple):
    """Changes of speed (n,) [1/s] at each reading, between the steps of `seconds` around it.

    In motion the speed is `fastest` and changes by `most` at most, both with the uncertainty of
    the readings. Steps that are too long to show how a joint stops show only jumps.
    """

    seconds: float
    change: np.ndarray
    most: float
    fastest: float


def _steps(time: np.ndarray, value: np.ndarray, first: np.ndarray, last: np.ndarray) -> _Steps:
    """The shortest steps that show motion above noise; the joint rests from `first` to `last`."""
    rate, length = sampling_rate(time), 1
    resolution = float(encoder_resolution(value[:, np.newaxis])[0])
    longest = limits.SHORTEST_STOP / 2 * rate
    while True:
        speed = (value[length:] - value[:-length]) / (time[length:] - time[:-length])
        change = np.zeros(len(value))
        change[length:-length] = np.abs(speed[length:] - speed[:-length])
        motion = np.arange(len(value)) >= length
        motion[-length:] = False
        for begin, end in zip(first, last, strict=True):
            motion[max(0, begin - length) : end + length + 1] = False
        in_motion, uncertain = np.abs(speed[motion[length:]]), resolution * rate / length
        most = float(change[motion].max(initial=0.0)) + 2.0 * uncertain
        fastest = float(in_motion.max(initial=0.0)) + uncertain
        if np.square(in_motion).sum() > most**2 * len(in_motion) or 2 * length > longest:
            limit = most if length <= longest else max(most, fastest)
            return _Steps(length / rate, change, limit, fastest)
        length *= 2


def _asked(log: Log, j: int, begin: float, end: float) -> Iterator[str]:
    """Evidence that joint j moved between `begin` and `end` [s], or was commanded to."""

    def during(signal: Signal) -> Signal:
        return signal.take(np.flatnonzero((signal.time >= begin) & (signal.time <= end)))

    if log.reference_position is not None:
        reference = during(log.reference_position).value[:, j]
        way = float(np.nan_to_num(np.ptp(reference))) if len(reference) else 0.0
        if way > limits.ASKED_WAY:
            yield f"its reference moves by {way:.3g} rad or m"
    if log.velocity is not None:
        speed = float(np.nanmax(np.abs(during(log.velocity).value[:, j]), initial=0.0))
        if speed > limits.ASKED_WAY:
            yield f"its velocity is logged as up to {speed:.3g} rad/s or m/s"
    if log.command is not None:
        command = during(log.command)
        asked = np.abs(command.value[:-1, j]) > limits.ASKED
        seconds = float(np.diff(command.time)[asked].sum())
        if seconds > limits.ASKED_FOR:
            yield f"its valve command was above {limits.ASKED:.0%} for {seconds:.1f} s"


def _moves(log: Log, j: int, time: np.ndarray) -> np.ndarray:
    """(n,) whether the joint moves by more than two counts around these times."""
    known = np.isfinite(log.position.value[:, j])
    at, q = log.position.time[known], log.position.value[known, j]
    step = encoder_resolution(q[:, np.newaxis])[0]
    ahead, behind = (
        np.interp(time + side, at, q) for side in (limits.SPEED_OVER / 2, -limits.SPEED_OVER / 2)
    )
    return np.abs(ahead - behind) > 2.0 * step


def _edges(value: np.ndarray) -> np.ndarray:
    """First sample of each plateau."""
    return np.flatnonzero(np.diff(value, prepend=np.nan) != 0.0)


def _plateaus(column: _Column) -> np.ndarray:
    """For each plateau, return whether the joint moves for suspiciously long during it."""
    moved = np.add.reduceat(column.moves, _edges(column.value))  # samples in motion
    if not moved.any():
        return np.zeros(len(moved), dtype=bool)
    usual = np.percentile(moved[moved > 0], 95)
    if len(moved) == 1:  # nothing to compare it with
        usual = 1.0
    return np.asarray(
        moved > max(limits.PLATEAU * sampling_rate(column.time), limits.RARELY * usual)
    )


def _unexpected(log: Log, signal: Signal, j: int, column: _Column, long: np.ndarray) -> np.ndarray:
    """For each plateau, return whether the other sensors predict a change of more than a step.

    They do so by a linear relation, learnt outside plateaus: positions, velocities, and all other
    forces or pressures. If nothing can be learnt, a plateau is suspicious if it fills most of the
    motion.
    """
    edges = _edges(column.value)
    ends = [*edges[1:], len(column.value)]
    features = _features(log, signal, j, column.time)
    usable = np.isfinite(features).all(axis=1) & column.moves
    learnt = usable & ~np.repeat(long, np.diff([*edges, len(column.value)]))
    moved = np.add.reduceat(column.moves, edges)
    if (
        learnt.sum() < limits.LEAST_TRAINED * features.shape[1]
        or column.steps < limits.FEWEST_STEPS
    ):
        return np.asarray(moved > limits.ENDLESS * column.moves.sum())
    scale = features[learnt].std(axis=0)
    features = (features - features[learnt].mean(axis=0)) / np.where(scale > 0.0, scale, 1.0)
    features = np.column_stack([features, np.ones(len(features))])
    found = np.linalg.lstsq(features[learnt], column.value[learnt], rcond=None)[0]
    expected = features @ found
    noise = float((column.value - expected)[learnt].std())
    least = max(limits.EXPECTED_STEPS * column.step, limits.EXPECTED_SIGMAS * noise)
    out = np.zeros(len(long), dtype=bool)
    for k in np.flatnonzero(long):
        inside = expected[edges[k] : ends[k]][usable[edges[k] : ends[k]]]
        out[k] = len(inside) > 0 and np.ptp(np.percentile(inside, limits.MOST)) > least
    return out


def _features(log: Log, signal: Signal, j: int, time: np.ndarray) -> np.ndarray:
    """(n, f) what all other sensors show at these times."""
    columns = []
    for k in range(len(log.joints)):
        known = np.isfinite(log.position.value[:, k])
        at, q = log.position.time[known], log.position.value[known, k]
        ahead, here, behind = (
            np.interp(time + side, at, q)
            for side in (limits.SPEED_OVER / 2, 0.0, -limits.SPEED_OVER / 2)
        )
        speed = (ahead - behind) / limits.SPEED_OVER
        rms = float(np.sqrt(np.mean(speed**2)))
        columns += [here, speed, np.tanh(4.0 * speed / rms) if rms else speed]
        columns += [here**2, ahead - 2.0 * here + behind]
    for measured in (log.force, log.pressure_a, log.pressure_b):
        if measured is None:
            continue
        for k in range(len(log.joints)):
            known = np.isfinite(measured.value[:, k])
            if (measured is not signal or k != j) and known.any():
                columns.append(np.interp(time, measured.time[known], measured.value[known, k]))
    return np.column_stack(columns)


def _still(column: _Column, long: np.ndarray) -> Iterator[Suspicion]:
    if not long.any():
        return
    value, moves, rate = column.value, column.moves, sampling_rate(column.time)
    edges = _edges(value)
    moved = np.add.reduceat(moves, edges)
    share = moved[long].sum() / moves.sum()
    level = value[edges[np.flatnonzero(long)[moved[long].argmax()]]]
    returns = moved[long].max() < limits.ENDLESS * moves.sum()
    end = {value.max(): "highest", value.min(): "lowest"}.get(level, "") if returns else ""
    evidence = (
        f"{share:.1%} of the motion at one reading, {level:.6g}"
        f"{f', the {end} of all' if end else ''}, for up to {moved[long].max() / rate:.2g} s"
    )
    cause = CAUSES[end] if value.any() else "nothing was measured: all readings are zero"
    yield Suspicion(
        column.where, evidence, cause, decisive=bool(share > limits.FROZEN) and end != "lowest"
    )
