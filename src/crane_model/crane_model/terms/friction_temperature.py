"""Viscous friction that falls as the oil warms up."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import JointTerm
from crane_model.terms.term import Family, Parameter

WORKING_TEMPERATURE = 40.0  # deg C: where nothing is added to viscous friction (10)


class TemperatureViscosity(JointTerm):
    """-f_T (T - 40 deg C) q': viscous friction that falls with the measured oil temperature T."""

    type: Literal["temperature_viscosity"] = "temperature_viscosity"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "temperature-dependent viscosity",
        "viscous friction falls as the oil temperature rises",
        ("viscous", "viscous_asymmetry", "warm_up"),
        "the same motion with cold and with warm oil",
        follows=("temperature", "velocity"),
    )

    def column(self, record: Record, j: int) -> Array:
        """-(T - 40 deg C) q'."""
        return (WORKING_TEMPERATURE - self.needed(record, "temperature")) * record.velocity[:, j]

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        unit = f"{force} s/({coordinate} degC)"
        return Parameter("f_T", unit, 0.0, "viscous friction lost with each degree")


class WarmUp(JointTerm):
    """f_w q' exp(-(t - since)/warming): viscous friction that dies out while the machine works.

    For recordings without an oil temperature. t counts from the first recording of a session, where
    stamps tell; `since` [s] is when the machine was cold.
    """

    type: Literal["warm_up"] = "warm_up"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "viscosity of oil that warms up",
        "viscous friction falls with the time since the start, whatever the motion",
        ("viscous", "viscous_asymmetry", "temperature_viscosity"),
        "the same motion with cold and with warm oil, and a record of the oil temperature",
        law_of="temperature_viscosity",
        follows=("time", "velocity"),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "warming": Shape(20.0, 7200.0, "s", 7, "time constant with which the oil warms up")
    }

    warming: float = Field(gt=0)
    since: float = 0.0

    def column(self, record: Record, j: int) -> Array:
        """q' exp(-(t - since)/warming)."""
        return record.velocity[:, j] * np.exp((self.since - record.time) / self.warming)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_w", f"{force} s/{coordinate}", 0.0, "viscous friction lost on warming")
