"""What an actuator of a joint is, and the registry of all types."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from crane_model.actuators.drawn import Bar
from crane_model.array import Array
from crane_model.configuration import Schema
from crane_model.linkages import PROPORTIONAL, Linkage, samples, tabulated
from crane_model.registry import of_type

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
