"""Column map: which column of a table, or which field of a topic, holds which quantity of which
joint, in which unit.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from crane_identification.data.sources import (
    AnySource,
    Cell,
    Column,
    Reading,
    Source,
    TopicField,
)
from crane_identification.data.units import COUNTS, DATE, UNITS
from crane_model.configuration import Schema
from crane_model.errors import DataError


def measuring(*quantities: str) -> AfterValidator:
    """Validator of a source that must measure one of `quantities`."""
    fitting = [unit for unit, (quantity, _) in UNITS.items() if quantity in quantities]

    def check(source: Source) -> Source:
        if source.quantity not in quantities:
            raise ValueError(f"unit {source.unit!r} measures {source.quantity}; use {fitting}")
        return source

    return AfterValidator(check)


def _plain_time(column: Column) -> Column:
    if column.file != "*":
        raise ValueError("every file has its time in the column of this name; take out file")
    if column.unit == DATE and (column.scale, column.offset) != (1.0, 0.0):
        raise ValueError(f"times of {DATE} have neither scale nor offset; take them out")
    return column


TimeColumn = Annotated[Column, measuring("time"), AfterValidator(_plain_time)]
Angle = Annotated[AnySource, measuring("angle", COUNTS)]
Position = Annotated[AnySource, measuring("angle", "length", COUNTS)]
Velocity = Annotated[AnySource, measuring("angular velocity", "linear velocity", COUNTS)]
Acceleration = Annotated[AnySource, measuring("angular acceleration", "linear acceleration")]
Force = Annotated[AnySource, measuring("torque", "force", COUNTS)]
Pressure = Annotated[AnySource, measuring("pressure", COUNTS)]
Command = Annotated[AnySource, measuring("command")]
Temperature = Annotated[AnySource, measuring("temperature", COUNTS)]

ANGULAR = {"angle", "angular velocity", "angular acceleration", "torque"}


class Cylinder(Schema):
    """A cylinder without a machine file: force = area_a * pressure_a - area_b * pressure_b.

    Areas in m², or volumes per angle in m³/rad for a hydraulic motor. Chamber A pushes the joint in
    its positive direction; a chamber that does nothing has no area.
    """

    area_a: Annotated[float, Field(ge=0)] = 0.0
    area_b: Annotated[float, Field(ge=0)] = 0.0

    def force(self, pressure_a: np.ndarray | float, pressure_b: np.ndarray | float) -> np.ndarray:
        """(n,) [N], or [N m], from pressures [Pa]."""
        return np.asarray(self.area_a * pressure_a - self.area_b * pressure_b)


class JointSources(Schema):
    """Where one joint's position is, and its force or the pressures of its cylinder.

    With both, the force is taken as given; the pressures are for terms that depend on them.
    """

    position: Position
    force: Force | None = None
    pressure_a: Pressure | None = None
    pressure_b: Pressure | None = None
    cylinder: Cylinder | None = None
    velocity: Velocity | None = None
    command: Command | None = None
    reference_position: Position | None = None
    reference_velocity: Velocity | None = None
    reference_acceleration: Acceleration | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.cylinder is not None:
            self._check_cylinder(self.cylinder)
        elif (self.pressure_a is None) != (self.pressure_b is None):
            raise ValueError("pressure_a and pressure_b are only of use together")
        elif self.force is None and self.pressure_a is None:
            raise ValueError("give either force, or pressure_a and pressure_b, or both")
        angular = self.position.quantity in ANGULAR
        for name, source in self.given().items():
            if name.startswith("pressure") or name == "command":
                continue
            if COUNTS in (source.quantity, self.position.quantity):
                continue
            if (source.quantity in ANGULAR) != angular:
                raise ValueError(
                    f"{name} in {source.unit!r} does not fit a position in {self.position.unit!r}"
                )
        return self

    def _check_cylinder(self, cylinder: Cylinder) -> None:
        if self.force is not None:
            raise ValueError("force and cylinder both say what the force is; give one of them")
        if not cylinder.area_a and not cylinder.area_b:
            raise ValueError("cylinder: area_a, area_b or both must be above 0")
        for side in ("a", "b"):
            pressure = getattr(self, f"pressure_{side}")
            if getattr(cylinder, f"area_{side}") and pressure is None:
                raise ValueError(f"cylinder: area_{side} needs pressure_{side}")
            if pressure is not None and pressure.quantity == COUNTS:
                raise ValueError(f"cylinder: needs pressure_{side} in a unit of pressure")

    def given(self) -> dict[str, Source]:
        """What the map names, by quantity."""
        names = (name for name in JointSources.model_fields if name != "cylinder")
        sources = {name: getattr(self, name) for name in names}
        return {name: source for name, source in sources.items() if source}


SHARED = ("slew_position", "supply_pressure", "tank_pressure", "temperature")


class ColumnMap(Schema):
    """Where recordings hold what: tables, whose time is a column or the rate [Hz], or topics of
    bags, whose messages have stamps.
    """

    joints: Annotated[dict[str, JointSources], Field(min_length=1)]
    time: TimeColumn | None = None
    rate: Annotated[float, Field(gt=0)] | None = None
    separator: Annotated[str, Field(min_length=1, max_length=1)] = ","
    decimal: Annotated[str, Field(pattern=r"^[.,]$")] = "."
    slew_position: Angle | None = None
    supply_pressure: Pressure | None = None
    tank_pressure: Pressure | None = None
    temperature: Temperature | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        kinds = {type(one) for one in self.readings()}
        if len(kinds) > 1:
            raise ValueError("columns of tables and topics of bags; write a map for each")
        if self.of_topics and not (self.time is self.rate is None):
            raise ValueError("the time of topics is that of their messages; take out time and rate")
        if not self.of_topics and (self.time is None) == (self.rate is None):
            raise ValueError("give either a time column or the sampling rate")
        if self.separator == self.decimal:
            raise ValueError(
                f"separator and decimal are both {self.decimal!r}; tables with a decimal comma "
                "have another separator, mostly ';'"
            )
        first, given = next((name, _quantities(one)) for name, one in self.joints.items())
        for joint, sources in self.joints.items():
            if different := given ^ _quantities(sources):
                raise ValueError(
                    f"{', '.join(sorted(different))}: given for only one of the joints '{first}' "
                    f"and '{joint}'; give it for all joints or for none"
                )
        return self

    @property
    def of_topics(self) -> bool:
        """Whether it is for bags."""
        return any(isinstance(one, TopicField) for one in self.readings())

    def shared(self) -> dict[str, Source]:
        """What belongs to no joint, by quantity."""
        sources = {name: getattr(self, name) for name in SHARED}
        return {name: source for name, source in sources.items() if source}

    @property
    def types(self) -> dict[str, str]:
        """Message types by topic, where the map states them."""
        fields = (one for one in self.readings() if isinstance(one, TopicField))
        return {one.topic: one.type for one in fields if one.type}

    def of(self, joints: Sequence[str], recording: Path | str) -> list[JointSources]:
        """What it says of each of `joints`; `DataError` names `recording` and what is absent."""
        if unknown := [joint for joint in joints if joint not in self.joints]:
            raise DataError(
                f"{recording}: the column map has no joint '{unknown[0]}'; it has "
                f"{', '.join(self.joints)}; add it, or rename the joints of the model"
            )
        return [self.joints[joint] for joint in joints]

    def cells(self, joints: Sequence[str], recording: Path | str) -> dict[str, list[Cell]]:
        """What is to be read for `joints`, by stream."""
        of_joints = [one for joint in self.of(joints, recording) for one in joint.given().values()]
        cells: dict[str, dict[Cell, None]] = {}
        for source in (*of_joints, *self.shared().values()):
            for reading in source.readings:
                cells.setdefault(reading.stream, {})[reading.cell] = None
        return {stream: list(one) for stream, one in cells.items()}

    def readings(self) -> Iterator[Reading]:
        """All that it names but the time."""
        for sources in (self.shared(), *(one.given() for one in self.joints.values())):
            for source in sources.values():
                yield from source.readings


def _quantities(sources: JointSources) -> set[str]:
    return {*sources.given(), *(["force"] if sources.cylinder else [])}
