"""Column map: which columns of a table hold which quantity of which joint, in which unit."""

from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from crane_identification.data.units import COUNTS, UNITS
from crane_model.configuration import Schema


class Column(Schema):
    """A column and how its numbers become a quantity: scale * number + offset, in `unit`."""

    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.unit not in UNITS:
            raise ValueError(f"unknown unit {self.unit!r}; use one of {', '.join(UNITS)}")
        if self.scale == 0.0:
            raise ValueError("scale must not be 0")
        return self

    @property
    def quantity(self) -> str:
        """What the unit measures."""
        return UNITS[self.unit].quantity

    def in_si(self, numbers: np.ndarray) -> np.ndarray:
        """The quantity in SI units."""
        return (self.scale * numbers + self.offset) * UNITS[self.unit].factor


def measuring(*quantities: str) -> AfterValidator:
    """Validator of a column that must measure one of `quantities`."""
    fitting = [unit for unit, (quantity, _) in UNITS.items() if quantity in quantities]

    def check(column: Column) -> Column:
        if column.quantity not in quantities:
            raise ValueError(f"unit {column.unit!r} measures {column.quantity}; use {fitting}")
        return column

    return AfterValidator(check)


TimeColumn = Annotated[Column, measuring("time")]
AngleColumn = Annotated[Column, measuring("angle", COUNTS)]
PositionColumn = Annotated[Column, measuring("angle", "length", COUNTS)]
VelocityColumn = Annotated[Column, measuring("angular velocity", "linear velocity", COUNTS)]
ForceColumn = Annotated[Column, measuring("torque", "force", COUNTS)]
PressureColumn = Annotated[Column, measuring("pressure", COUNTS)]
CommandColumn = Annotated[Column, measuring("command")]
TemperatureColumn = Annotated[Column, measuring("temperature", COUNTS)]

ANGULAR = {"angle", "angular velocity", "torque"}


class JointColumns(Schema):
    """The columns of one joint: its position, and its force or the pressures of its cylinder.

    With both, the force is taken as given; the pressures are for terms that depend on them.
    """

    position: PositionColumn
    force: ForceColumn | None = None
    pressure_a: PressureColumn | None = None
    pressure_b: PressureColumn | None = None
    velocity: VelocityColumn | None = None
    command: CommandColumn | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.pressure_a is None) != (self.pressure_b is None):
            raise ValueError("pressure_a and pressure_b are only of use together")
        if self.force is None and self.pressure_a is None:
            raise ValueError("give either force, or pressure_a and pressure_b, or both")
        angular = self.position.quantity in ANGULAR
        for name in ("force", "velocity"):
            column = getattr(self, name)
            if column is None or COUNTS in (column.quantity, self.position.quantity):
                continue
            if (column.quantity in ANGULAR) != angular:
                raise ValueError(
                    f"{name} in {column.unit!r} does not fit a position in {self.position.unit!r}"
                )
        return self

    def given(self) -> dict[str, Column]:
        """The columns that the map names, by quantity."""
        columns = {name: getattr(self, name) for name in JointColumns.model_fields}
        return {name: column for name, column in columns.items() if column}


class ColumnMap(Schema):
    """Where a table holds what. Time is a column, or the rate at which rows were sampled [Hz]."""

    joints: Annotated[dict[str, JointColumns], Field(min_length=1)]
    time: TimeColumn | None = None
    rate: Annotated[float, Field(gt=0)] | None = None
    separator: Annotated[str, Field(min_length=1, max_length=1)] = ","
    slew_position: AngleColumn | None = None
    supply_pressure: PressureColumn | None = None
    tank_pressure: PressureColumn | None = None
    temperature: TemperatureColumn | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.time is None) == (self.rate is None):
            raise ValueError("give either a time column or the sampling rate")
        first, given = next((name, set(one.given())) for name, one in self.joints.items())
        for joint, columns in self.joints.items():
            if different := given ^ set(columns.given()):
                raise ValueError(
                    f"{', '.join(sorted(different))}: given for only one of the joints '{first}' "
                    f"and '{joint}'; give it for all joints or for none"
                )
        return self

    def shared(self) -> dict[str, Column]:
        """The columns that belong to no joint, by quantity."""
        names = ("slew_position", "supply_pressure", "tank_pressure", "temperature")
        columns = {name: getattr(self, name) for name in names}
        return {name: column for name, column in columns.items() if column}
