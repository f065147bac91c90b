"""What makes a term a candidate for an effect that a model lacks."""

from typing import Literal, NamedTuple

import numpy as np

from crane_model.array import Array

Variable = Literal[
    "position",
    "velocity",
    "acceleration",
    "way since it turned",
    "force",
    "force against the motion",
    "rate of the force",
    "lead",
    "pressure sum",
    "pressure of chamber B",
    "extension of the telescope",
    "inclination of the telescope",
    "slew velocity",
    "temperature",
    "time",
    "recording",
]
"""What the force of an effect may depend on, beside the direction of motion."""


class Effect(NamedTuple):
    """A physical effect as people speak of it."""

    name: str
    signature: str  # how it shows in the residual of a model that lacks it
    confusable: tuple[str, ...]  # types of the terms that it is easily taken for
    settled_by: str  # the experiment that tells it from them
    kin: tuple[str, ...] = ()  # types of terms that are other laws of the same effect: one class
    law_of: str = ""  # type of the term that is the usual law of the same effect, if not this one
    follows: tuple[Variable, ...] = ()  # what its force depends on, first that which shows it best
    formless: bool = False  # one factor of what the model has: no law whose form could differ
    usual: float = 0.0  # size of its parameters that any sound machine may have
    largest: float = float("inf")  # size of its parameters, beyond which it is no such effect


class DrawnCurve(NamedTuple):
    """A law that is drawn: values (k,) at knots (k,) of a variable, to be multiplied by `times`."""

    variable: Variable
    knots: tuple[float, ...]
    values: Array
    times: str


class Shape(NamedTuple):
    """A field of a term in which its force is not linear, and where its value is sought.

    Values are tried in equal ratios or, where that is what changes the force evenly, `even` steps.
    """

    lowest: float
    highest: float
    unit: str
    points: int
    meaning: str
    even: bool = False

    @property
    def grid(self) -> Array:
        """(points,) from lowest to highest."""
        return self.spread(self.points)

    def spread(self, points: int) -> Array:
        """(points,) values from lowest to highest."""
        return (np.linspace if self.even else np.geomspace)(self.lowest, self.highest, points)

    def unit_on(self, coordinate: str) -> str:
        """The unit on a joint of this coordinate, rad or m; those of both kinds are given."""
        both = self.unit.split(" or ")
        return both[-1] if coordinate == "m" else both[0]

    def share(self, value: float) -> float:
        """Where a value lies between lowest, 0, and highest, 1."""
        if self.even:
            return (value - self.lowest) / (self.highest - self.lowest)
        return float(np.log(value / self.lowest) / np.log(self.highest / self.lowest))

    def value(self, share: float) -> float:
        """The value at that `share`, which is kept from 0 to 1."""
        share = min(max(share, 0.0), 1.0)
        if self.even:
            return self.lowest + share * (self.highest - self.lowest)
        return float(self.lowest * (self.highest / self.lowest) ** share)
