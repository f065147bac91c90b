"""Valves from the ramps of bring-up, for joints that recordings tell nothing of.

Bring-up fits the speed K (u - d) of a joint beyond its dead band d. In the words of the flow map,
with the opening o = (u - d)/(1 - d) of the spool and no load, this is

    K (1 - d) dx/dq o = gain o sqrt(drop / (A_A^3 + A_B^3)).
"""

from collections.abc import Mapping
from math import hypot, sqrt
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from crane_identification.hydraulics.balance import DAMPING_RATIO
from crane_identification.hydraulics.joint_estimate import settled_by, undetermined
from crane_model.configuration import Positive, Schema, load
from crane_model.cylinders import lever_arm
from crane_model.errors import DataError
from crane_model.hydraulics.values import (
    GAIN,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine import Machine

OIL = ("bulk_modulus", "dead_volume_a", "dead_volume_b", "leakage")
ASSUMED = ("hysteresis", "natural_frequency")
ALIKE = 1e-6  # levers of a joint that has one alone


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
    """Of one joint, by the sign of the command."""

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
        provenance="; ".join(told) or f"{path} tells nothing more",
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
    if np.ptp(levers) > ALIKE * lever:
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
        "dead_zone_a": _mean(extending.dead_band, extending.dead_band_std, extending),
        "dead_zone_b": _mean(retracting.dead_band, retracting.dead_band_std, retracting),
        "hysteresis": Measured(value=0.0, unit="1"),
        "lag": Measured(value=lag, std_dev=abs(extending.lag - retracting.lag) / 2.0, unit="s"),
        "natural_frequency": Measured(value=2.0 * DAMPING_RATIO / lag, unit="rad/s"),
    }
    valve = ValveValues(
        **values,
        damping_ratio=Measured(value=DAMPING_RATIO, unit="1"),
        supply_a=forth,
        b_tank=forth,
        supply_b=back,
        a_tank=back,
    )
    return JointHydraulics(
        valve=valve,
        undetermined=undetermined(values)
        | {name: settled_by(name) for name in ASSUMED}
        | {name: f"pressure transducers, then {settled_by(name)}" for name in OIL},
        unexplained=max((one.gain_std or 0.0) / one.gain for one in (extending, retracting)),
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
    return Measured(value=scale * stroke * ramp.gain, std_dev=scale * spread, unit=GAIN)


def _mean(value: float, std_dev: float, ramp: Ramp) -> Measured:
    return Measured(value=value, std_dev=std_dev / sqrt(ramp.repeats), unit="1")
