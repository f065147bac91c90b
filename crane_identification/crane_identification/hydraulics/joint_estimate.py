"""The hydraulics of one joint with pressure transducers."""

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np

from crane_identification.data.log import Log
from crane_identification.hydraulics.balance import (
    CUT_OFF,
    DAMPING_RATIO,
    EDGES,
    LINEAR,
    Balance,
    ChamberRows,
    MotionRows,
)
from crane_identification.hydraulics.passage import passages
from crane_identification.hydraulics.projection import (
    BLOCK,
    BalanceFit,
    block_covariance,
    lack_of_fit,
    project,
)
from crane_model.errors import DataError, RangeError
from crane_model.hydraulics.values import (
    GAIN,
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    SupplyValues,
    ValveValues,
)
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

LARGEST_UNEXPLAINED = 0.2  # rms share of the flow, beyond which the values mean nothing
SIGMAS = 4.0  # standard deviations by which a sign is certain
TINY = 1e-300
KNOWN = 0.25  # of a value: a larger standard deviation does not determine it
KNOWN_PART = 0.005  # of the stroke, for dead zones and hysteresis, which may be 0
KNOWN_LEAKAGE = 1e-14  # m3/(s Pa), for a piston that may be tight
SETTLED_BY = {
    "dead_zone": "slow ramps of the command through zero, both ways",
    "hysteresis": "slow triangles of the command, to and fro",
    "lag": "steps of the command both ways",
    "natural_frequency": "a pseudo-random command of +-0.02 on top of the motion for 60 s "
    "(crane_trajectory design --probe 0.02)",
    "gain": "motion both ways at several speeds",
    "bulk_modulus": "more reversals under load, over the whole stroke",
    "dead_volume": "reversals with the piston near the end at which that chamber is smallest",
    "leakage": "a load held for a minute with the valve closed, and motion at several loads",
}
"""By the beginning of a value's name, the experiment that tells it."""


ASSUMED_MODULUS = 1.3e9  # Pa, mineral oil with hoses: where no cylinder of the machine tells


class JointFit(NamedTuple):
    """What is known of a joint, and the fit that it is known from."""

    values: JointHydraulics
    projection: BalanceFit
    balance: Balance[ChamberRows]


def identify_joint(
    machine: Machine,
    joint: str,
    logs: Sequence[Log],
    period: float | None = None,
    modulus: float = ASSUMED_MODULUS,
) -> JointFit:
    """Valve and chambers; `DataError` says why the recordings do not tell them.

    A motor's chambers stay as large as they are, so that it tells only what they hold over the bulk
    modulus of the oil: for it, the `modulus` [Pa] is assumed.
    """
    cylinder = machine.cylinders[joint]
    known = None if cylinder.chambers.grow else modulus
    balance = Balance([ChamberRows(part, cylinder) for part in passages(machine, joint, logs)])
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
            undetermined=undetermined(values),
            unexplained=found.unexplained,
            lack_of_fit=lack_of_fit(balance, found, logs, period),
        ),
        found,
        balance,
    )


def undetermined(values: Mapping[str, Measured]) -> dict[str, str]:
    """Names of those that are not known well enough, each with the experiment that tells it."""
    return {name: settled_by(name) for name, one in values.items() if not _known(name, one)}


def settled_by(name: str) -> str:
    """The experiment that tells a value."""
    if name in EDGES:
        return SETTLED_BY["gain"]
    return next(text for key, text in SETTLED_BY.items() if name.startswith(key))


def _require_sense(found: BalanceFit, modulus: float | None) -> None:
    """`DataError` where the flow runs against the valve, or the oil grows under pressure."""
    std_devs = np.sqrt(np.diag(found.covariance))[-len(LINEAR) :]
    sigmas = dict(zip(LINEAR, found.linear / np.maximum(std_devs, TINY), strict=True))
    remedy = "check sign and log of its command, and that its chambers are not exchanged"
    if against := [edge for edge in EDGES if sigmas[edge] <= SIGMAS]:
        raise DataError(f"the flow does not follow the valve at {', '.join(against)}; {remedy}")
    if modulus is not None:
        del sigmas["compliance"]  # nothing but rounding
    oil = [name for name in LINEAR[len(EDGES) :] if sigmas.get(name, 0.0) < -SIGMAS]
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
    """What is known of the spool, by name."""
    spool = found.spool
    return {
        "dead_zone_a": _measured(found, spool.dead_zone_a, "1", dead_zone_a=1.0),
        "dead_zone_b": _measured(found, spool.dead_zone_b, "1", dead_zone_b=1.0),
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


def _known(name: str, one: Measured) -> bool:
    if one.std_dev is None:  # assumed
        return True
    enough = KNOWN * abs(one.value)
    if name.startswith("dead_zone") or name == "hysteresis":
        enough = max(enough, KNOWN_PART)
    if name == "leakage":
        enough = max(enough, KNOWN_LEAKAGE)
    return one.std_dev <= enough


# The valve of a joint without pressure transducers: dead zones, gains and lag from its motion.


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
    if (gains <= SIGMAS * std_devs).any() or found.unexplained > LARGEST_UNEXPLAINED:
        raise DataError(
            f"hydraulics of '{joint}': its speed does not follow its valve "
            f"({found.unexplained:.0%} unexplained); check sign and log of its command, or record "
            "slow ramps of it both ways"
        )
    forth, back = (
        Measured(value=float(gain), std_dev=float(std), unit=GAIN)
        for gain, std in zip(gains, std_devs, strict=True)
    )
    values = measured_spool(found)
    valve = ValveValues(
        **values,
        damping_ratio=Measured(value=DAMPING_RATIO, unit="1"),
        supply_a=forth,
        b_tank=forth,
        supply_b=back,
        a_tank=back,
    )
    oil = ("bulk_modulus", "dead_volume_a", "dead_volume_b", "leakage")
    return JointHydraulics(
        valve=valve,
        undetermined=undetermined(valve.by_name)
        | {name: f"pressure transducers, then {settled_by(name)}" for name in oil},
        unexplained=found.unexplained,
    )


# The supply that all valves share: its pressure falls with the flow that they draw.
#
#     p_S = p_0 - R sum of what flows from the supply into chambers
#
# A pressure-controlled pump follows within milliseconds, far above what the filter of the balance
# leaves, so that the volume of the line does not show.

LARGEST_SLEW = 0.01  # rad: beyond, the slew has drawn oil that nobody measured


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
        one, pressure = rows.supply().T
        drawn = sum(part.drawn(fit.spool, fit.linear) for fit, part in passage)
        time = rows.thinned(rows.time)
        columns.append(rows.thinned(np.stack([one, -drawn], axis=1)))
        pressures.append(rows.thinned(pressure))
        blocks.append(begun + ((time - time[0]) / BLOCK).astype(int))
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


def _shared(
    found: Sequence[JointFit],
) -> list[list[tuple[BalanceFit, ChamberRows]]]:
    """Rows of all joints that begin and end together."""
    together: dict[tuple[str, float, int], list[tuple[BalanceFit, ChamberRows]]] = {}
    for joint in found:
        for rows in joint.balance.rows:
            part = rows.passage
            key = (part.source, round(float(part.time[0]), 3), len(part))
            together.setdefault(key, []).append((joint.projection, rows))
    return [parts for parts in together.values() if len(parts) == len(found)]


# The hydraulics of a machine from recordings of its motion, joint by joint.


def identify_hydraulics(
    model: Model, logs: Sequence[Log], period: float | None = None, progress: Progress = silent
) -> HydraulicValues | None:
    """What recordings tell of valves, oil and supply; None if no command shows anything of them.

    Joints of which nothing can be told are named with the reason.
    """
    machine = model.machine
    wanted = [log for log in logs if log.command is not None]
    if machine is None or not wanted:
        return None
    unknown: dict[str, str] = {}
    found: dict[str, JointFit] = {}
    sensed = {joint for joint, one in machine.cylinders.items() if one.pressure_sensors}
    fitted = sorted(  # those last that take the oil of the others for their own
        (joint for joint in model.joints if joint in sensed),
        key=lambda joint: not machine.cylinders[joint].chambers.grow,
    )
    blind = [joint for joint in machine.cylinders if joint not in sensed]
    for number, joint in enumerate(fitted):
        try:
            found[joint] = identify_joint(machine, joint, wanted, period, _oil_of(found))
        except (DataError, RangeError) as error:
            unknown[joint] = str(error)
        progress("hydraulics", (number + 1) / len(fitted))
    supply = None
    if found and len(found) == len(fitted):
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
    rows = sum(len(one.balance.flow) for one in found.values())
    sources = ", ".join(dict.fromkeys(log.source for log in wanted))
    return HydraulicValues(
        provenance=f"balance of flow below {CUT_OFF:g} Hz, both chambers, {rows} rows of {sources}",
        joints=joints,
        supply=supply,
        unknown=unknown,
    )


def _oil_of(found: Mapping[str, JointFit]) -> float:
    """Mean bulk modulus [Pa] of the joints that tell it."""
    chambers = [one.values.chambers for one in found.values()]
    told = [one.bulk_modulus.value for one in chambers if one and one.bulk_modulus.std_dev]
    return fmean(told) if told else ASSUMED_MODULUS
