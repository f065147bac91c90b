"""What an actuator of a joint is, and the registry of all types."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.configuration import Schema
from crane_model.linkages import PROPORTIONAL, Linkage, samples, tabulated
from crane_model.registry import of_type

# What pictures show of an actuator: lines between pins, in the plane across the joint's axis.
#
# x of the plane is that of the joint's frame, before it moves; the joint is at its origin.


class Bar(NamedTuple):
    """A part between two pins (2,) [m]: a cylinder, or a link."""

    begin: Array
    end: Array
    is_cylinder: bool


def direction(angle: float) -> Array:
    """Unit vector (2,)."""
    return np.array([math.cos(angle), math.sin(angle)])


def meeting(one: Array, radius: float, other: Array, other_radius: float) -> Array:
    """Where two circles meet, to the right of the line between them; nan where they do not."""
    line = other - one
    distance = math.hypot(*line)
    along = (radius**2 - other_radius**2 + distance**2) / (2.0 * distance)
    square = radius**2 - along**2
    across = math.sqrt(square) if square >= 0.0 else math.nan
    unit = line / distance
    found: Array = one + along * unit + across * np.array([unit[1], -unit[0]])
    return found


TABULATED = 501  # places; quintic between them, errors fall with the sixth power

REGISTRY: dict[str, type["Actuator"]] = {}


class Actuator(Schema, ABC):
    """What drives a joint: its own coordinate x(q), and so its force F as tau = dx/dq F (18).

    A subclass gives its `type` in machine files and is registered by being defined. x is a length
    [m] where it pushes, an angle [rad] where it turns. `has_chambers` if F follows from two
    pressures (19): then it is a `HydraulicActuator`; `has_rotor` if it is a
    motor that turns with x = gear ratio times q; not `drives` if it is none at all;
    `bounded_by_pins` if it is a cylinder whose length runs from pin to pin.
    """

    type: str
    has_chambers: ClassVar[bool] = False
    has_rotor: ClassVar[bool] = False
    drives: ClassVar[bool] = True
    bounded_by_pins: ClassVar[bool] = False

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            REGISTRY[name] = cls

    @abstractmethod
    def motion(self, q: Array) -> Array:
        """(n,) coordinates of the joint to (n, 3): x, dx/dq, d2x/dq2; nan where it cannot be."""

    def linkage(self, low: float, high: float) -> Linkage:
        """The same for compiled code, from `low` to `high`: here, of a class of one's own."""
        return tabulated(low, high, self.motion(np.linspace(low, high, TABULATED)))

    def bars(self, q: float) -> tuple[Bar, ...]:
        """What pictures show of it; nothing where it is within the joint."""
        return ()

    def check(self, low: float, high: float) -> None:
        """`ValueError` unless it can drive its joint from `low` to `high`."""
        return


class BuiltIn(Actuator):
    """An actuator that `crane_model.linkages` has compiled."""

    @property
    @abstractmethod
    def compiled(self) -> Linkage:
        """Its kind and constants there."""

    def motion(self, q: Array) -> Array:
        """x, dx/dq, d2x/dq2 (n, 3)."""
        return samples(*self.compiled, q)

    def linkage(self, low: float, high: float) -> Linkage:
        """Exact, wherever it is."""
        return self.compiled


def proportional(ratio: float) -> Linkage:
    """x = `ratio` q."""
    return Linkage(PROPORTIONAL, np.array([ratio]))


def actuator_from_mapping(content: Mapping[str, Any] | Actuator) -> Actuator:
    """The actuator that an entry of a machine file describes; ValueError as pydantic wants it."""
    if isinstance(content, Actuator):
        return content
    return of_type(content, REGISTRY, "actuator", "those of installed packages included")
