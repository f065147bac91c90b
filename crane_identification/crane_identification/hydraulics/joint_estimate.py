"""The hydraulics of one joint with pressure transducers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from pathlib import Path
from statistics import fmean
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from crane_identification.data.log import Log
from crane_identification.hydraulics.balance import (
    CUT_OFF,
    DAMPING_RATIO,
    EDGES,
    FINE,
    LINEAR,
    METERING_DROP,
    Balance,
    ChamberRows,
    MotionRows,
    Passage,
    passages,
)
from crane_identification.hydraulics.projection import (
    CORRELATED_BLOCK_S,
    BalanceFit,
    block_covariance,
    lack_of_fit,
    project,
)
from crane_model.configuration import Positive, Schema, load
from crane_model.cylinders import lever_arm
from crane_model.errors import DataError, RangeError
from crane_model.hydraulics import (
    GAIN_UNIT,
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    SupplyValues,
    ValveValues,
)
from crane_model.machine import LoadSensing, Machine
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

LARGEST_UNEXPLAINED = 0.2  # rms share of the flow, beyond which the values mean nothing
SIGN_SIGMAS = 4.0  # standard deviations by which a sign is certain
LEAST_DENOMINATOR = 1e-300
DETERMINED_SIGMA_SHARE = 0.25  # of a value: a larger standard deviation does not determine it
KNOWN_PART = 0.005  # of the stroke, for dead bands and hysteresis, which may be 0
KNOWN_LEAKAGE = 1e-14  # m3/(s Pa), for a piston that may be tight
DISCRIMINATED_BY = {
    "dead_band": "slow ramps of the command through zero, in both directions",
    "hysteresis": "slow triangles of the command, to and fro",
    "lag": "steps of the command in both directions",
    "natural_frequency": "a pseudo-random command of +-0.02 on top of the motion for 60 s "
    "(crane_trajectory design --probe 0.02)",
    "gain": "motion in both directions at several speeds",
    "bulk_modulus": "more reversals under load, over the whole stroke",
    "dead_volume": "reversals with the piston near the end at which that chamber is smallest",
    "leakage": "a load held for a minute with the valve closed, and motion at several loads",
}
"""By the beginning of a value's name, the experiment that tells it."""


ASSUMED_MODULUS = 1.3e9  # Pa, mineral oil with hoses: where no cylinder of the machine tells
LARGEST_SLEW = 0.01  # rad: beyond, the slew has drawn oil that nobody measured
OIL = ("bulk_modulus", "dead_volume_a", "dead_volume_b", "leakage")
ASSUMED = ("hysteresis", "natural_frequency")
LEVER_TOLERANCE = 1e-6  # levers of a joint that has one alone


class JointFit(NamedTuple):
    """Estimates of a joint, and their fit."""

    values: JointHydraulics
    projection: BalanceFit
    balance: Balance[ChamberRows]


def identify_joint(
    machine: Machine,
    joint: str,
    logs: Sequence[Log],
    period: float | None = None,
    modulus: float = ASSUMED_MODULUS,
    loads: "HighestLoads | None" = None,
) -> JointFit:
    """Valve and chambers; `DataError` says why the recordings do not tell them.

    `loads` are those of all joints, for valves that share the flow of one pump.

    A motor's chambers stay as large as they are, so that it tells only what they hold over the bulk
    modulus of the oil: for it, the `modulus` [Pa] is assumed.
    """
    cylinder = machine.cylinders[joint]
    known = None if cylinder.chambers.grow else modulus
    parts = passages(machine, joint, logs)
    if loads is not None:
        parts = [loads.shared(part) for part in parts]
    balance = Balance([ChamberRows(part, cylinder) for part in parts])
    try:
        found = project(balance)
        _require_sense(found, known)
    except DataError as error:
        raise DataError(f"hydraulics of '{joint}': {error}") from None
    values = _values(found, known)
    valve = ValveValues(**{name: values[name] for name in ValveValues.units})
    chambers = ChamberValues(**{name: values[name] for name in ChamberValues.units})
    return JointFit(
        JointHydraulics(
            valve=valve,
            chambers=chambers,
            undetermined=undetermined(values) | early_spool(found, values),
            unexplained=found.unexplained,
            lack_of_fit=lack_of_fit(balance, found, logs, period),
        ),
        found,
        balance,
    )


def undetermined(values: Mapping[str, Measured]) -> dict[str, str]:
    """Names of those that are not known well enough, each with the experiment that tells it."""
    return {
        name: discriminated_by(name)
        for name, measured in values.items()
        if not _known(name, measured)
    }


def early_spool(found: BalanceFit, values: Mapping[str, Measured]) -> dict[str, str]:
    """The lag, with the experiment that tells it, if the spool would move before its command: then
    flow that the valve does not pass has taken the lag for its own.
    """
    early = -found.spool.delay > SIGN_SIGMAS * (values["lag"].std_dev or 0.0)
    return {"lag": discriminated_by("lag")} if early else {}


def discriminated_by(name: str) -> str:
    """The experiment that tells a value."""
    if name in EDGES:
        return DISCRIMINATED_BY["gain"]
    return next(text for key, text in DISCRIMINATED_BY.items() if name.startswith(key))


def _require_sense(found: BalanceFit, modulus: float | None) -> None:
    """`DataError` where the flow runs against the valve, or the oil grows under pressure."""
    std_devs = np.sqrt(np.diag(found.covariance))[-len(LINEAR) :]
    sigmas = dict(zip(LINEAR, found.linear / np.maximum(std_devs, LEAST_DENOMINATOR), strict=True))
    remedy = "check sign and log of its command, and that its chambers are not exchanged"
    if against := [edge for edge in EDGES if sigmas[edge] <= SIGN_SIGMAS]:
        raise DataError(f"the flow does not follow the valve at {', '.join(against)}; {remedy}")
    if modulus is not None:
        del sigmas["compliance"]  # nothing but rounding
    oil = [name for name in LINEAR[len(EDGES) :] if sigmas.get(name, 0.0) < -SIGN_SIGMAS]
    if oil or sigmas.get("compliance", 1.0) <= 0.0:
        raise DataError(
            f"{', '.join(oil or ['compliance'])} of the oil would be negative; {remedy}, or record "
            "more reversals under load"
        )
    if found.unexplained > LARGEST_UNEXPLAINED:
        raise DataError(
            f"valve and oil leave {found.unexplained:.0%} of its flow unexplained, at most "
            f"{LARGEST_UNEXPLAINED:.0%} allowed; {remedy}"
        )


def measured_spool(found: BalanceFit) -> dict[str, Measured]:
    """Estimates of the spool, by name."""
    spool = found.spool
    return {
        "dead_band_a": _measured(found, spool.dead_band_a, "1", dead_band_a=1.0),
        "dead_band_b": _measured(found, spool.dead_band_b, "1", dead_band_b=1.0),
        "hysteresis": _measured(found, spool.play, "1", play=1.0),
        "lag": _measured(found, spool.lag, "s", lag=1.0),
        "natural_frequency": _measured(
            found,
            spool.frequency,
            "rad/s",
            lag=spool.frequency / spool.lag,
            share=spool.frequency / max(spool.share, 1e-6),
        ),
    }


def _values(found: BalanceFit, known: float | None) -> dict[str, Measured]:
    """All by name; of the bulk modulus that is `known` [Pa], if it is."""
    linear = dict(zip(LINEAR, found.linear, strict=True))
    modulus = known or 1.0 / linear["compliance"]
    out = measured_spool(found) | {
        "damping_ratio": Measured(value=DAMPING_RATIO, unit="1"),
        "leakage": _measured(found, linear["leakage"], "m3/(s Pa)", leakage=1.0),
        "bulk_modulus": Measured(value=modulus, unit="Pa")
        if known
        else _measured(found, modulus, "Pa", compliance=modulus**2),
    }
    for edge in EDGES:
        out[edge] = _measured(found, linear[edge], ValveValues.units[edge], **{edge: 1.0})
    for chamber in "ab":
        softness = linear[f"softness_{chamber}"]
        slopes = {f"softness_{chamber}": modulus}
        if not known:
            slopes["compliance"] = -softness * modulus**2
        out[f"dead_volume_{chamber}"] = _measured(found, softness * modulus, "m3", **slopes)
    return out


def _measured(found: BalanceFit, value: float, unit: str, **slopes: float) -> Measured:
    """A value, at least 0, whose slopes against parameters of the fit are given by their names."""
    names = (*found.spool._fields, *LINEAR[: len(found.linear)])
    gradient = np.array([slopes.get(name, 0.0) for name in names])
    std_dev = float(np.sqrt(gradient @ found.covariance @ gradient))
    return Measured(value=max(float(value), 0.0), std_dev=std_dev, unit=unit)


def _known(name: str, measured: Measured) -> bool:
    if measured.std_dev is None:  # assumed
        return True
    enough = DETERMINED_SIGMA_SHARE * abs(measured.value)
    if name.startswith("dead_band") or name == "hysteresis":
        enough = max(enough, KNOWN_PART)
    if name == "leakage":
        enough = max(enough, KNOWN_LEAKAGE)
    return measured.std_dev <= enough


# The valve of a joint without pressure transducers: dead bands, gains and lag from its motion.


def identify_motion(machine: Machine, joint: str, logs: Sequence[Log]) -> JointHydraulics:
    """Its valve, as if the load were nil; `DataError` says why the recordings do not tell it.

    The gains hold for the load against which it moved, friction above all, and the lag includes
    that of its oil; what else oil and load do stays in what is unexplained.
    """
    cylinder = machine.cylinders[joint]
    balance = Balance([MotionRows(part, cylinder) for part in passages(machine, joint, logs)])
    found = project(balance)
    gains = found.linear
    std_devs = np.sqrt(np.diag(found.covariance))[-len(gains) :]
    if (gains <= SIGN_SIGMAS * std_devs).any() or found.unexplained > LARGEST_UNEXPLAINED:
        raise DataError(
            f"hydraulics of '{joint}': its speed does not follow its valve "
            f"({found.unexplained:.0%} unexplained); check sign and log of its command, or record "
            "slow ramps of it in both directions"
        )
    forth, back = (
        Measured(value=float(gain), std_dev=float(std), unit=GAIN_UNIT)
        for gain, std in zip(gains, std_devs, strict=True)
    )
    valve = _valve_of_speeds(measured_spool(found), forth, back)
    return JointHydraulics(
        valve=valve,
        undetermined=undetermined(valve.by_name)
        | {name: f"pressure transducers, then {discriminated_by(name)}" for name in OIL},
        unexplained=found.unexplained,
    )


def _valve_of_speeds(spool: Mapping[str, Measured], forth: Measured, back: Measured) -> ValveValues:
    """Values of a valve whose speeds alone are known: both edges of a direction have one gain."""
    return ValveValues(
        **spool,
        damping_ratio=Measured(value=DAMPING_RATIO, unit="1"),
        supply_a=forth,
        b_tank=forth,
        supply_b=back,
        a_tank=back,
    )


# The supply that all valves share: its pressure falls with the flow that they draw.
#
#     p_S = p_0 - R sum of what flows from the supply into chambers
#
# A pressure-controlled pump follows within milliseconds, far above what the filter of the balance
# leaves, so that the volume of the line does not show.


def identify_supply(found: Sequence[JointFit], logs: Sequence[Log]) -> SupplyValues:
    """Pressure and droop; `DataError` where a joint that draws oil is not among those `found`."""
    still = {log.source for log in logs if _still(log)}
    if not still:
        raise DataError(
            "supply: a joint without transducers moves in each recording and draws oil that "
            "nobody measured; record one in which it rests"
        )
    columns, pressures, blocks = [], [], []
    begun = 0
    for passage in _shared(found):
        rows = passage[0][1]
        if rows.passage.source not in still:
            continue
        unit, pressure = rows.supply().T
        drawn = sum(part.drawn(fit.spool, fit.linear) for fit, part in passage)
        time = rows.thinned(rows.time)
        columns.append(rows.thinned(np.stack([unit, -drawn], axis=1)))
        pressures.append(rows.thinned(pressure))
        blocks.append(begun + ((time - time[0]) / CORRELATED_BLOCK_S).astype(int))
        begun = int(blocks[-1][-1]) + 1
    if not columns:
        raise DataError("supply: no part of a recording in which the flow of all joints is known")
    matrix, pressure, block = (np.concatenate(part) for part in (columns, pressures, blocks))
    norms = np.linalg.norm(matrix, axis=0)
    scaled = matrix / norms
    bread = np.linalg.pinv(scaled.T @ scaled)
    values = bread @ scaled.T @ pressure
    covariance = block_covariance(scaled, pressure - scaled @ values, bread, block)
    std_devs = np.sqrt(np.diag(covariance)) / norms
    level, droop = values / norms
    return SupplyValues(
        pressure=Measured(value=float(level), std_dev=float(std_devs[0]), unit="Pa"),
        droop=Measured(value=max(float(droop), 0.0), std_dev=float(std_devs[1]), unit="Pa s/m3"),
    )


def _still(log: Log) -> bool:
    slew = log.slew_position
    return slew is None or float(np.nanmax(slew.value) - np.nanmin(slew.value)) < LARGEST_SLEW


def _shared(found: Sequence[JointFit]) -> list[list[tuple[BalanceFit, ChamberRows]]]:
    together: dict[tuple[str, float, int], list[tuple[BalanceFit, ChamberRows]]] = {}
    for joint in found:
        for rows in joint.balance.rows:
            part = rows.passage
            key = (part.source, round(float(part.time[0]), 3), len(part))
            together.setdefault(key, []).append((joint.projection, rows))
    return [parts for parts in together.values() if len(parts) == len(found)]


# One pump that all valves share, with load sensing and flow sharing.
#
# All edges that feed have the same drop, p_S - p_L, where p_L is the highest pressure of the
# chambers that are fed: the margin of the pump, and less if it is at its limit. The openings of all
# valves tell which chambers are fed, so valves are first fitted with the margin as their drop.

SHARING_ROUNDS = 2  # of valves from loads, and loads from valves


@dataclass(frozen=True)
class HighestLoads:
    """p_L of each recording by its source: times (n,) [s] and pressures (n,) [Pa]."""

    sensing: LoadSensing
    course: Mapping[str, tuple[np.ndarray, np.ndarray]]

    def shared(self, part: Passage) -> Passage:
        """The passage with the drop at the edges that feed."""
        supply = part.pressures["supply_pressure"]
        drop = np.full(len(part), self.sensing.margin)  # where no load is known
        if part.source in self.course:
            load = np.interp(part.time, *self.course[part.source])
            drop = np.clip(supply - load, 0.0, self.sensing.largest_drop)
        return replace(part, pressures={**part.pressures, METERING_DROP: drop})


def highest_loads(
    machine: Machine, joints: Sequence[str], logs: Sequence[Log], sensing: LoadSensing
) -> HighestLoads:
    """From the valves of `joints`; those of which nothing can be told count as closed."""
    loads = HighestLoads(sensing, {})
    for _ in range(SHARING_ROUNDS):
        fed: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for joint in joints:
            try:
                parts = [loads.shared(part) for part in passages(machine, joint, logs)]
            except DataError:
                continue
            rows = [ChamberRows(part, machine.cylinders[joint]) for part in parts]
            spool = project(Balance(rows)).spool
            for row in rows:
                pressures, opened = row.passage.pressures, row.opening(spool)[::FINE]
                tank = pressures["tank_pressure"]
                load = np.where(opened > 0.0, pressures["pressure_a"], pressures["pressure_b"])
                course = row.passage.time, np.where(opened == 0.0, tank, load)
                fed.setdefault(row.passage.source, []).append(course)
        loads = HighestLoads(sensing, {source: _highest(parts) for source, parts in fed.items()})
    return loads


def _highest(courses: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    time = np.unique(np.concatenate([time for time, _ in courses]))
    each = [np.interp(time, *course, left=0.0, right=0.0) for course in courses]
    return time, np.max(each, axis=0)


# The hydraulics of a machine from recordings of its motion, joint by joint.


def identify_hydraulics(
    model: Model, logs: Sequence[Log], period: float | None = None, progress: Progress = silent
) -> HydraulicValues | None:
    """Identify valves, oil and supply from recordings; None if no command shows any of them.

    Joints without an estimate are listed with the reason.
    """
    machine = model.machine
    wanted = [log for log in logs if log.command is not None]
    if machine is None or not wanted:
        return None
    unknown: dict[str, str] = {}
    found: dict[str, JointFit] = {}
    sensed = {joint for joint, cylinder in machine.cylinders.items() if cylinder.pressure_sensors}
    fitted = sorted(  # those last that take the oil of the others for their own
        (joint for joint in model.joints if joint in sensed),
        key=lambda joint: not machine.cylinders[joint].chambers.grow,
    )
    blind = [joint for joint in machine.cylinders if joint not in sensed]
    sensing = machine.hydraulics.load_sensing
    loads = highest_loads(machine, fitted, wanted, sensing) if sensing else None
    for number, joint in enumerate(fitted):
        try:
            found[joint] = identify_joint(machine, joint, wanted, period, _oil_of(found), loads)
        except (DataError, RangeError) as error:
            unknown[joint] = str(error)
        progress("hydraulics", (number + 1) / len(fitted))
    supply = None
    if found and len(found) == len(fitted) and not sensing:
        try:
            supply = identify_supply(tuple(found.values()), wanted)
        except DataError as error:
            unknown["supply"] = str(error)
    joints = {joint: found[joint].values for joint in model.joints if joint in found}
    for joint in blind:
        try:
            joints[joint] = identify_motion(machine, joint, wanted)
        except (DataError, RangeError) as error:
            unknown[joint] = str(error)
    if not joints and not any(log.pressure_a is not None for log in wanted):
        return None
    rows = sum(len(fit.balance.flow) for fit in found.values())
    sources = ", ".join(dict.fromkeys(log.source for log in wanted))
    return HydraulicValues(
        provenance=f"balance of flow below {CUT_OFF:g} Hz, both chambers, {rows} rows of {sources}",
        joints=joints,
        supply=supply,
        unknown=unknown,
    )


def _oil_of(found: Mapping[str, JointFit]) -> float:
    """Mean bulk modulus [Pa] of the joints that tell it."""
    chambers = [fit.values.chambers for fit in found.values()]
    told = [
        chamber.bulk_modulus.value
        for chamber in chambers
        if chamber and chamber.bulk_modulus.std_dev
    ]
    return fmean(told) if told else ASSUMED_MODULUS


# Valves from the ramps of bring-up, for joints that recordings tell nothing of.
#
# Bring-up fits the speed K (u - d) of a joint beyond its dead band d. In the words of the flow map,
# with the opening o = (u - d)/(1 - d) of the spool and no load, this is
#
#     K (1 - d) dx/dq o = gain o sqrt(drop / (A_A^3 + A_B^3)).


class Ramp(Schema):
    """One direction: means and standard deviations between repeats, as bring-up writes them."""

    dead_band: Annotated[float, Field(ge=0, lt=1)]
    dead_band_std: Annotated[float, Field(ge=0)]
    gain: Positive
    gain_std: Annotated[float, Field(ge=0)] | None = None
    lag: Positive
    repeats: Annotated[int, Field(ge=1)]
    rate: Positive | None = None


class Ramps(Schema):
    """Ramps of one joint, by the sign of the command."""

    positive: Ramp
    negative: Ramp


class RampFile(Schema):
    """`result.yaml` of `bringup dead_band`."""

    step: str
    date: str
    mapping: str
    protocol: dict[str, float]
    results: dict[str, Ramps]


def with_ramps(known: HydraulicValues | None, path: Path, machine: Machine) -> HydraulicValues:
    """`known`, and from a file of ramps the valves of those joints that it lacks."""
    file = load(path, RampFile)
    if strange := sorted(set(file.results) - set(machine.cylinders)):
        raise DataError(
            f"{path}: the machine has no actuator for {', '.join(strange)}, it has "
            f"{', '.join(machine.cylinders)}; give the ramps of this machine"
        )
    joints = dict(known.joints) if known else {}
    unknown = dict(known.unknown) if known else {}
    added = []
    for joint, ramps in file.results.items():
        if joint in joints:
            continue  # a recording tells more, and under load
        try:
            joints[joint] = from_ramps(machine, joint, ramps)
            added.append(joint)
            unknown.pop(joint, None)
        except DataError as error:
            unknown[joint] = "; ".join(filter(None, (unknown.get(joint), str(error))))
    told = [known.provenance] if known else []
    if added:
        told.append(f"{', '.join(added)}: ramps of {file.date}, {path}")
    return HydraulicValues(
        provenance="; ".join(told) or f"{path} adds nothing",
        joints=joints,
        supply=known.supply if known else None,
        unknown=unknown,
    )


def from_ramps(machine: Machine, joint: str, ramps: Ramps) -> JointHydraulics:
    """The valve of a joint, as if the load were nil; `DataError` says why ramps do not tell it.

    `unexplained` is by how much the speeds of repeats differ. All of the lag is taken for that of
    the spool.
    """
    limits = machine.limits[joint]
    positions = np.linspace(limits.position_min, limits.position_max, 20)
    levers = lever_arm(machine, joint, positions)
    lever = abs(float(levers.mean()))
    if np.ptp(levers) > LEVER_TOLERANCE * lever:
        raise DataError(
            f"hydraulics of '{joint}': its lever changes with its position, which ramps do not "
            "hold; record a motion of it"
        )
    extending, retracting = (
        (ramps.positive, ramps.negative) if levers[0] > 0.0 else (ramps.negative, ramps.positive)
    )
    cylinder, oil = machine.cylinders[joint], machine.hydraulics
    a, b = cylinder.area_a, cylinder.area_b
    supply, tank = oil.supply_pressure, oil.tank_pressure
    drops = a * supply - b * tank, b * supply - a * tank
    forth, back = (
        _gain(joint, ramp, lever / sqrt(drop / (a**3 + b**3)))
        for ramp, drop in zip((extending, retracting), drops, strict=True)
    )
    lag = (extending.lag + retracting.lag) / 2.0
    values: Mapping[str, Measured] = {
        "dead_band_a": _mean(extending.dead_band, extending.dead_band_std, extending),
        "dead_band_b": _mean(retracting.dead_band, retracting.dead_band_std, retracting),
        "hysteresis": Measured(value=0.0, unit="1"),
        "lag": Measured(value=lag, std_dev=abs(extending.lag - retracting.lag) / 2.0, unit="s"),
        "natural_frequency": Measured(value=2.0 * DAMPING_RATIO / lag, unit="rad/s"),
    }
    return JointHydraulics(
        valve=_valve_of_speeds(values, forth, back),
        undetermined=undetermined(values)
        | {name: discriminated_by(name) for name in ASSUMED}
        | {name: f"pressure transducers, then {discriminated_by(name)}" for name in OIL},
        unexplained=max(
            (direction.gain_std or 0.0) / direction.gain for direction in (extending, retracting)
        ),
    )


def _gain(joint: str, ramp: Ramp, scale: float) -> Measured:
    """`scale` is the gain [m3/(s Pa^0.5)] for 1 rad/s or m/s of the joint at full opening."""
    if ramp.gain_std is None:
        raise DataError(
            f"hydraulics of '{joint}': its ramps were run once, so that nothing is known of how "
            "far its gain is off; repeat them: bringup dead_band with two repeats or more"
        )
    stroke, count = 1.0 - ramp.dead_band, sqrt(ramp.repeats)
    spread = hypot(stroke * ramp.gain_std, ramp.gain * ramp.dead_band_std) / count
    return Measured(value=scale * stroke * ramp.gain, std_dev=scale * spread, unit=GAIN_UNIT)


def _mean(value: float, std_dev: float, ramp: Ramp) -> Measured:
    return Measured(value=value, std_dev=std_dev / sqrt(ramp.repeats), unit="1")
