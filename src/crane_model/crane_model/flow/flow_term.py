"""What a term of the flow balance is, and the registry of all of them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from crane_model.configuration import Schema
from crane_model.machine import Machine
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.term import Parameter

FLOW_REGISTRY: dict[str, type["FlowTerm"]] = {}


class FlowTerm(Schema, ABC):
    """A summand of the flow into the chambers of one cylinder, linear in its parameters.

    As with the terms of the torque model, a subclass is registered by being defined, and with an
    `effect` it is a candidate for what a model of the flow lacks.
    """

    type: str
    effect: ClassVar[Effect | None] = None
    shapes: ClassVar[Mapping[str, Shape]] = MappingProxyType({})

    joint: str

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            FLOW_REGISTRY[name] = cls

    @abstractmethod
    def flow_parameters(self) -> tuple[Parameter, ...]:
        """The parameters, without the joint in their names."""

    @abstractmethod
    def columns(self, record: Record, machine: Machine) -> np.ndarray:
        """Flow into chambers A and B for one unit of each parameter: (n, 2, parameters) [m3/s].

        `DataError` names a signal that the record does not have: then the effect is not observable.
        """

    def parameters(self) -> tuple[Parameter, ...]:
        """Each named symbol.joint."""
        return tuple(p._replace(name=f"{p.name}.{self.joint}") for p in self.flow_parameters())

    def needed(self, record: Record, signal: str) -> np.ndarray:
        """(n,) of this joint, or of the machine; `DataError` if it was not recorded."""
        values = record.needed(signal, f"flow term '{self.type}'")
        return values if values.ndim == 1 else values[:, record.column(self.joint)]


def flow_candidates() -> list[type[FlowTerm]]:
    """Flow terms with an `effect`, in the order of their types."""
    return [cls for _, cls in sorted(FLOW_REGISTRY.items()) if cls.effect is not None]
