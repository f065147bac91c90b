"""What describes a law of a hidden effect, and such a law with its parameters in a machine."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crane_model.machine import JOINT_UNITS, PLANAR_JOINTS
from crane_sim.effects.fault import SensorFault
from crane_sim.parts.parameters import StandIn

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
    `unit`, {force} and {coordinate} stand for N m and rad, on the telescope for N and m.
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


class Form(NamedTuple):
    """A law of an effect. `law` is its number in compiled code, or the fault of sensors it is."""

    effect: str
    name: str
    law: int | type[SensorFault]
    magnitude: Magnitude
    draws: tuple[Draw, ...] = ()
    joints: tuple[str, ...] = PLANAR_JOINTS  # on which it can act; empty: the whole machine
    outside: bool = False  # of the catalogue that a diagnosis knows
    signed: bool = False  # its magnitude may as well be negative, which is drawn too

    def unit(self, text: str, joint: str | None) -> str:
        """The unit of a parameter on a joint."""
        coordinate = JOINT_UNITS[joint] if joint else "rad"
        return text.format(force="N" if coordinate == "m" else "N m", coordinate=coordinate)


class Planted(NamedTuple):
    """A form with its parameters: the magnitude, then those drawn, in the order of the form."""

    form: Form
    joint: str | None
    values: tuple[float, ...]
    requested: float | None = None  # strength that was asked for
