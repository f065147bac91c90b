"""What describes a law of a hidden effect, and such a law with its parameters in a machine."""

from collections.abc import Callable, Sequence
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crane_model.machine import Machine
from crane_sim.parts.parameters import StandIn

# What a sensor may do wrong.


def measured_joints(machine: Machine) -> tuple[str, ...]:
    """The joints whose chamber pressures are measured, from the base to the tip."""
    return tuple(joint for joint, one in machine.cylinders.items() if one.pressure_sensors)


class SensorFault:
    """A law between true signals and what noise-free sensors show of them.

    `values` are the parameters in the order of the form; `joint` is that of the faulty sensor.
    """

    def __init__(self, machine: Machine, joint: str, values: Sequence[float]):
        self.column = machine.index(joint)
        self.measured = [machine.index(one) for one in measured_joints(machine)]
        self.values = tuple(values)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (..., j) [rad, m] as the encoders see them."""
        return q

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pressures of the chambers (n, j) [Pa] as the transducers see them at `time` (n,) [s]."""
        return chamber_a, chamber_b


Scale = Callable[[StandIn, str], float]


def coulomb(stand_in: StandIn, joint: str) -> float:
    """f_c of the joint [N m, N]."""
    return stand_in.friction[joint].f_c


def viscous(stand_in: StandIn, joint: str) -> float:
    """f_v of the joint [N m s/rad, N s/m]."""
    return stand_in.friction[joint].f_v


def unscaled(stand_in: StandIn, joint: str) -> float:
    """In the unit of the parameter itself: a factor of 1."""
    return 1.0


class Magnitude(NamedTuple):
    """The parameter that is set so that the effect has the wanted strength.

    Calibration begins at `start` and refuses to go beyond `highest`, both in units of `of`. In
    `unit`, {force} and {coordinate} stand for N m and rad, on a joint that slides for N and m.
    """

    name: str
    unit: str
    start: float
    highest: float
    of: Scale = unscaled


class Draw(NamedTuple):
    """A further parameter, drawn between two values in units of `of`: evenly, or by `ratio`."""

    name: str
    unit: str
    lowest: float
    highest: float
    of: Scale = unscaled
    ratio: bool = False

    def between(self, rng: np.random.Generator) -> float:
        """A value in units of `of`."""
        if self.ratio:
            return float(np.exp(rng.uniform(np.log(self.lowest), np.log(self.highest))))
        return float(rng.uniform(self.lowest, self.highest))


class Where(Enum):
    """On which joints an effect can act, of those whose pressures are measured; or on none of
    them by itself, but on the whole of certain machines.
    """

    ANY = "a joint"
    TURNING = "a joint that turns"
    SLIDING = "a joint that slides"
    FOLLOWING = "a joint that follows another such"
    WHOLE = "the whole machine"
    SLEWING = "the whole of a machine whose first joint turns and is not measured"
    TELESCOPIC = "the whole of a machine that has a joint which slides"

    def joints(self, machine: Machine) -> tuple[str, ...]:
        """Those of a machine, from the base to the tip."""
        measured, units = measured_joints(machine), machine.units
        match self:
            case Where.ANY:
                return measured
            case Where.TURNING:
                return tuple(joint for joint in measured if units[joint] == "rad")
            case Where.SLIDING:
                return tuple(joint for joint in measured if units[joint] == "m")
            case Where.FOLLOWING:
                names = machine.joint_names
                pairs = pairwise(names)
                return tuple(joint for last, joint in pairs if {last, joint} <= set(measured))
            case _:
                return ()

    @property
    def whole(self) -> bool:
        """Whether no joint is to be named."""
        return self in (Where.WHOLE, Where.SLEWING, Where.TELESCOPIC)

    def fits(self, machine: Machine) -> bool:
        """Whether there is such a joint, or it is such a machine."""
        first = machine.joint_names[0]
        match self:
            case Where.WHOLE:
                return True
            case Where.SLEWING:
                return machine.units[first] == "rad" and first not in measured_joints(machine)
            case Where.TELESCOPIC:
                return "m" in machine.units.values()
            case _:
                return bool(self.joints(machine))


class Form(NamedTuple):
    """A law of an effect. `law` is its number in compiled code, or the fault of sensors it is."""

    effect: str
    name: str
    law: int | type[SensorFault]
    magnitude: Magnitude
    draws: tuple[Draw, ...] = ()
    where: Where = Where.ANY
    outside: bool = False  # of the catalogue that a diagnosis knows
    signed: bool = False  # its magnitude may as well be negative, which is drawn too

    def unit(self, text: str, machine: Machine, joint: str | None) -> str:
        """The unit of a parameter on a joint."""
        coordinate = machine.units[joint] if joint else "rad"
        return text.format(force="N" if coordinate == "m" else "N m", coordinate=coordinate)


class Planted(NamedTuple):
    """A form with its parameters: the magnitude, then those drawn, in the order of the form."""

    form: Form
    joint: str | None
    values: tuple[float, ...]
    requested: float | None = None  # strength that was asked for
