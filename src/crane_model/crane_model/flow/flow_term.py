"""What a term of the flow balance is."""

from abc import ABC, abstractmethod

from crane_model.array import Array
from crane_model.configuration import Schema
from crane_model.machine import Machine
from crane_model.record import Record


class FlowTerm(Schema, ABC):
    """A summand of the flow into the chambers of one cylinder, linear in its parameters."""

    type: str
    joint: str

    @abstractmethod
    def columns(self, record: Record, machine: Machine) -> Array:
        """Flow into chambers A and B for one unit of each parameter: (n, 2, parameters) [m3/s].

        `DataError` names a signal that the record does not have: then the effect is not observable.
        """

    def needed(self, record: Record, signal: str) -> Array:
        """(n,) of this joint, or of the machine; `DataError` if it was not recorded."""
        values = record.needed(signal, f"flow term '{self.type}'")
        return values if values.ndim == 1 else values[:, record.column(self.joint)]
