"""What transducers show of a force that they follow through some filter, whatever its form."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.chambers import lever
from crane_model.terms.drawn import DrawnTerm
from crane_model.terms.effect import Variable
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting

LEADS = (-0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3)  # s


class FilteredReading(DrawnTerm):
    """sum_k w_k (F(t + lead_k) - F(t)) dx/dq: transducers behind a linear filter of any form (18).

    The machine felt F(t) + sum_k w_k (F(t + lead_k) - F(t)): all of a constant force, which tells
    a filter from a gain. A reading that is late shows at later instants what the machine felt, so
    that most weights are of leads; one of early pressures has weights of leads below zero. The
    knots are the leads [s].
    """

    type: Literal["filtered_reading"] = "filtered_reading"
    family: ClassVar[Family] = "sensing"
    said: ClassVar[str] = "a force that follows the change of the measured force"
    draws: ClassVar[tuple[str, ...]] = ("time_skew",)
    variable: ClassVar[Variable] = "lead"
    spacing: ClassVar[tuple[float, ...]] = LEADS
    kept: ClassVar[tuple[int, ...]] = tuple(k for k, lead in enumerate(LEADS) if lead)
    times: ClassVar[tuple[str, ...]] = ("F(t + lead) - F(t)",)

    knots: tuple[float, ...] = Field(examples=[LEADS])

    @classmethod
    def over(cls, x: Array) -> tuple[float, ...]:
        """The leads, whatever the force."""
        return LEADS

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """tau."""
        return record.needed("force", "a shape of a filter")[:, j]

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """1."""
        return np.ones((len(record), 1))

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """One."""
        meaning = f"weight of what is shown {self.knots[k]:g} s later"
        return (Parameter(f"w_lead_{k + 1}", "1", None, meaning),)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """(F(t + lead) - F(t)) dx/dq: (n, leads)."""
        arm = lever(setting, self.joint, record)
        leads = [self.knots[k] for k in self.kept]
        columns: Array = np.stack([led(self, record, arm, lead) for lead in leads], axis=1)
        return columns


def led(term: OneJointTerm, record: Record, arm: Array, lead: float) -> Array:
    """(F(t + lead) - F(t)) dx/dq (n,) on the joint of a term, whose lever `arm` (n,) is dx/dq."""
    j = record.column(term.joint)
    force = term.needed(record, "force")[:, j]
    if record.force_at is not None:
        later: Array = record.force_at(lead)[:, j] - force
        return later
    return arm * (record.shifted(force / arm, lead) - force / arm)
