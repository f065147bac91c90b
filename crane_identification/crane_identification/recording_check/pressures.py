"""Pressures against supply, relief valve, tank and range: units, signs, absolute for gauge."""

from collections.abc import Iterator

import numpy as np

from crane_identification.data.log import Log, Signal
from crane_identification.notation import spoken
from crane_identification.recording_check.suspicion import (
    ALMOST_ALL,
    FEEBLE,
    FULL,
    NEAR_ATMOSPHERE,
    OFTEN,
    SUPPLY,
    UNITS_OF_PRESSURE,
    VACUUM,
    Suspicion,
)
from crane_model.flow.oil import ATMOSPHERE
from crane_model.machine import Machine

MEGA = 1e6


def pressures(machine: Machine, log: Log) -> Iterator[Suspicion]:
    """What is suspicious of the transducers of the machine's cylinders, supply and tank."""
    if log.pressure_a is not None and log.pressure_b is not None:
        for j, joint in enumerate(log.joints):
            if joint in machine.cylinders:
                both = [log.pressure_a.value[:, j], log.pressure_b.value[:, j]]
                yield from _cylinder(machine, joint, *(one[np.isfinite(one)] for one in both))
    if log.supply_pressure is not None:
        yield from _supply(machine, log.supply_pressure)
    if log.tank_pressure is not None:
        yield from _tank(machine, log.tank_pressure)


def _cylinder(
    machine: Machine, joint: str, chamber_a: np.ndarray, chamber_b: np.ndarray
) -> Iterator[Suspicion]:
    supply, relief = machine.hydraulics.supply_pressure, machine.hydraulics.relief_pressure
    where = f"pressures of the {spoken(joint)}"
    lowest, highest = (float(np.percentile([*chamber_a, *chamber_b], p)) for p in ALMOST_ALL)
    if lowest < VACUUM:
        turned = "the sign is turned" if highest < -VACUUM else "the zero or the sign is wrong"
        evidence = f"down to {lowest / MEGA:.4g} MPa, and vacuum is -0.1 MPa"
        yield Suspicion(where, evidence, turned, decisive=True)
    elif highest < FEEBLE * supply:
        evidence = f"at most {highest:.4g} Pa, and the supply has {supply:.4g} Pa"
        unit = _unit(highest, supply)
        cause = f"they look like {unit}" if unit else "the pump was off, or the unit is wrong"
        yield Suspicion(where, evidence, cause, decisive=True)
    else:
        often = float(np.percentile(np.maximum(*_paired(chamber_a, chamber_b)), 100 * (1 - OFTEN)))
        if often > FULL[1] * relief:
            yield Suspicion(
                where,
                f"above {often / MEGA:.4g} MPa for {OFTEN:.0%} of the time, and the relief valve "
                f"opens at {relief / MEGA:.4g} MPa",
                "they look too large: a wrong unit or range of the transducers, or the relief "
                "valve of the machine file",
                decisive=True,
            )


def _paired(chamber_a: np.ndarray, chamber_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(len(chamber_a), len(chamber_b))
    return chamber_a[:count], chamber_b[:count]


def _unit(highest: float, supply: float) -> str:
    """The unit in which a cylinder's highest pressure makes sense, or nothing."""
    low, high = FULL
    fits = [
        u for u, pa in UNITS_OF_PRESSURE.items() if low * supply <= pa * highest <= high * supply
    ]
    return " or ".join(fits)


def _supply(machine: Machine, signal: Signal) -> Iterator[Suspicion]:
    seen, stated = float(np.nanmedian(signal.value)), machine.hydraulics.supply_pressure
    if not SUPPLY[0] * stated <= seen <= SUPPLY[1] * stated:
        unit = _unit(seen, stated)
        yield Suspicion(
            "supply pressure",
            f"{seen:.4g} Pa, and the machine file has {stated:.4g} Pa",
            f"it looks like {unit}" if unit else "the transducer or the machine file is wrong",
            decisive=False,
        )


def _tank(machine: Machine, signal: Signal) -> Iterator[Suspicion]:
    """A tank that has one atmosphere too much: pressures are measured against vacuum."""
    seen, stated = float(np.nanmedian(signal.value)), machine.hydraulics.tank_pressure
    if abs(seen - stated - ATMOSPHERE) < NEAR_ATMOSPHERE:
        yield Suspicion(
            "tank pressure",
            f"{seen / MEGA:.3f} MPa, and the machine file has {stated / MEGA:.3f} MPa",
            "pressures look absolute; gauge is needed: subtract 0.101 MPa from all of them",
            decisive=False,
        )
