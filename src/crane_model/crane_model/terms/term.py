"""What a term of the model is, and the registry of all of them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from crane_model.configuration import Schema
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape

REGISTRY: dict[str, type["Term"]] = {}

Family = Literal[
    "rigid body", "friction", "gravity and load", "elasticity", "sensing", "hydraulics"
]


class Parameter(NamedTuple):
    """One entry of Theta. `minimum` is its sign constraint, None where either sign is physical."""

    name: str
    unit: str
    minimum: float | None
    meaning: str


class Setting(NamedTuple):
    """What a term may know of its model: units of the joints' coordinates, and the machine."""

    units: Mapping[str, str]  # joint -> rad or m
    machine: Machine | None

    def force_unit(self, joint: str) -> str:
        """N m for a revolute joint, N for a prismatic one."""
        return "N m" if self.units[joint] == "rad" else "N"


class Term(Schema, ABC):
    """A summand of the generalized force, linear in its parameters.

    A subclass gives `type` (its name in model files) and `family`, documents its equation, and is
    registered by being defined. Fields are its shape parameters and the joints it acts on. With an
    `effect` it is a candidate for what a model lacks, and `shapes` says where its shape parameters,
    fields of the same name, are then sought; `of_model` names fields that are not sought but hold
    the values of parameters of the model, if it has all of them. A `nuisance` stands for an error
    of the data: its columns may go beside a model, but it is never what the model lacks.
    """

    type: str
    family: ClassVar[Family]
    effect: ClassVar[Effect | None] = None
    nuisance: ClassVar[bool] = False
    shapes: ClassVar[Mapping[str, Shape]] = MappingProxyType({})
    of_model: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            REGISTRY[name] = cls

    @property
    def of_recordings(self) -> bool:
        """Whether it says what single recordings carried, which is no property of the machine."""
        return False

    @abstractmethod
    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """Name, unit, sign of each parameter; `ConfigurationError` if the model cannot hold it."""

    @abstractmethod
    def fill(self, record: Record, setting: Setting, columns: np.ndarray) -> None:
        """Write the regressor columns on n samples of j joints, SI units.

        `columns` (n, j, parameters) comes as zeros, a part of the regressor of the whole model.
        """

    def needed(self, record: Record, signal: str) -> np.ndarray:
        """A signal of the record that not every recording has; `DataError` if it is missing."""
        return record.needed(signal, f"term '{self.type}'")

    def columns(self, record: Record, setting: Setting) -> np.ndarray:
        """The regressor columns by themselves: (n, j, parameters), SI units."""
        columns = np.zeros((*record.position.shape, len(self.parameters(setting))))
        self.fill(record, setting, columns)
        return columns


def term_from_mapping(content: Mapping[str, Any]) -> Term:
    """The term that an entry of a model file describes; raises ValueError as pydantic wants it."""
    name = content.get("type") if isinstance(content, Mapping) else None
    if name not in REGISTRY:
        known = ", ".join(sorted(REGISTRY))
        raise ValueError(f"no term of type {name!r}; there are {known}, and those of --terms FILE")
    return REGISTRY[name].model_validate(content)
