"""Column map: which column of a table, or which field of a topic, holds which quantity of which
joint, in which unit.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from crane_model.configuration import Schema
from crane_model.errors import DataError

TABLES = (".csv", ".tsv", ".txt", ".parquet", ".mat")
COUNTS = "counts"
"""Unit and quantity of a sensor that was never calibrated: its numbers stay as they are."""
DATE = "ISO 8601"
"""Unit of times that are texts, with or without a date: 2026-05-04T09:30:00.25+02:00."""
ANGULAR = {"angle", "angular velocity", "angular acceleration", "torque"}
SHARED_QUANTITIES = ("slew_position", "supply_pressure", "tank_pressure", "temperature")


class Unit(NamedTuple):
    """Quantity of a unit, and its size in SI units (temperature: degrees Celsius)."""

    quantity: str
    factor: float


UNITS = {
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
    DATE: Unit("time", 1.0),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", math.pi / 180),
    "m": Unit("length", 1.0),
    "cm": Unit("length", 1e-2),
    "mm": Unit("length", 1e-3),
    "rad/s": Unit("angular velocity", 1.0),
    "deg/s": Unit("angular velocity", math.pi / 180),
    "rpm": Unit("angular velocity", math.pi / 30),
    "m/s": Unit("linear velocity", 1.0),
    "mm/s": Unit("linear velocity", 1e-3),
    "rad/s2": Unit("angular acceleration", 1.0),
    "deg/s2": Unit("angular acceleration", math.pi / 180),
    "m/s2": Unit("linear acceleration", 1.0),
    "mm/s2": Unit("linear acceleration", 1e-3),
    "N": Unit("force", 1.0),
    "kN": Unit("force", 1e3),
    "N m": Unit("torque", 1.0),
    "kN m": Unit("torque", 1e3),
    "Pa": Unit("pressure", 1.0),
    "kPa": Unit("pressure", 1e3),
    "MPa": Unit("pressure", 1e6),
    "bar": Unit("pressure", 1e5),
    "psi": Unit("pressure", 6894.757293168),
    "deg C": Unit("temperature", 1.0),
    "-": Unit("command", 1.0),
    "%": Unit("command", 1e-2),
    COUNTS: Unit(COUNTS, 1.0),
}


# Sources that a column map names: columns of tables, fields of topics, and sums of them.

Cell = tuple[str, int | str | None]
"""A column or field, and the place in it where it is a matrix or an array."""


class Reading(Schema):
    """Numbers of a recording, and how they become a quantity: scale * number + offset, in `unit`.

    A `scale` of -1 turns the sign.
    """

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
        return UNITS[self.unit].quantity

    @property
    def readings(self) -> tuple["Reading", ...]:
        """Itself: what is read to know the quantity."""
        return (self,)

    def combined(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The quantity (n,) out of those of its `readings`."""
        return values[0]

    @property
    @abstractmethod
    def stream(self) -> str:
        """Source of the numbers and their time: a pattern of file names, or a topic."""

    @property
    @abstractmethod
    def cell(self) -> Cell:
        """Which number of a row or message."""

    @property
    @abstractmethod
    def label(self) -> str:
        """How messages speak of it."""

    def in_si(self, numbers: np.ndarray) -> np.ndarray:
        return (self.scale * numbers + self.offset) * UNITS[self.unit].factor


class Column(Reading):
    """A column of a table.

    Where a recording is a folder of tables, `file` is the name, or a pattern of the names (`*`), of
    those that hold the column. In a MAT file `column` may lead into structs (`log.boom.angle`, with
    numbers where they are arrays, from 0), and `index` is the column of a matrix, from 0.
    """

    column: str
    index: Annotated[int, Field(ge=0)] | None = None
    file: str = "*"

    @property
    def stream(self) -> str:
        return self.file

    @property
    def cell(self) -> Cell:
        """Column, and column of a matrix."""
        return self.column, self.index

    @property
    def label(self) -> str:
        return self.column if self.index is None else f"{self.column}[{self.index}]"


def _in_full(msgtype: str) -> str:
    """`pkg/Type` as `pkg/msg/Type`."""
    package, *_, name = msgtype.split("/")
    return f"{package}/msg/{name}"


class TopicField(Reading):
    """A field of the messages of a topic.

    `field` may lead into fields (`wrench.force.x`). Of an array, `index` is the place, from 0, or
    the name that stands at that place in the array `name` of the message. `type` is needed by the
    node alone, which listens before anyone may publish; with bags it is checked.
    """

    topic: str
    field: str
    index: Annotated[int, Field(ge=0)] | str | None = None
    type: Annotated[str, Field(pattern=r"^\w+/(msg/)?\w+$"), AfterValidator(_in_full)] | None = None

    @property
    def stream(self) -> str:
        return self.topic

    @property
    def cell(self) -> Cell:
        return self.field, self.index

    @property
    def label(self) -> str:
        """Topic, field and place."""
        place = "" if self.index is None else f"[{self.index}]"
        return f"{self.topic} {self.field}{place}"


def _kind(content: Any) -> str | None:
    """Which kind of source an entry is, by the key that only this kind has."""
    if isinstance(content, Schema):
        return f"<{type(content).__name__}>"
    kinds = {"column": "<Column>", "topic": "<TopicField>", "sum": "<Sum>", "size": "<Directed>"}
    found = [kinds[key] for key in kinds if isinstance(content, dict) and key in content]
    return found[0] if len(found) == 1 else None


_NO_KIND = Discriminator(
    _kind,
    custom_error_type="source",
    custom_error_message="needs one of the keys column (table), topic (bag), sum and size",
)
Addend = Annotated[
    Annotated[Column, Tag("<Column>")] | Annotated[TopicField, Tag("<TopicField>")], _NO_KIND
]


class Sum(Schema):
    """The sum of readings of one quantity; a `scale` of -1 subtracts."""

    sum: Annotated[tuple[Addend, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _alike(self) -> Self:
        if len({addend.quantity for addend in self.sum}) > 1:
            units = ", ".join(addend.unit for addend in self.sum)
            raise ValueError(f"a sum of different quantities, in {units}; give units of one")
        return self

    @property
    def quantity(self) -> str:
        return self.sum[0].quantity

    @property
    def unit(self) -> str:
        return self.sum[0].unit

    @property
    def readings(self) -> tuple[Reading, ...]:
        return self.sum

    def combined(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The sum (n,)."""
        return np.asarray(np.sum(values, axis=0))

    @property
    def label(self) -> str:
        first, *rest = self.sum
        signs = ["-" if addend.scale < 0 else "+" for addend in rest]
        return " ".join(
            [first.label, *(f"{s} {o.label}" for s, o in zip(signs, rest, strict=True))]
        )


class Directed(Schema):
    """A reading without sign, and one that says which way it counts: `size` where `direction` has
    the value `positive`, -size where it is `negative`, and 0 elsewhere.
    """

    size: Addend
    direction: Addend
    positive: float
    negative: float

    @property
    def quantity(self) -> str:
        return self.size.quantity

    @property
    def unit(self) -> str:
        return self.size.unit

    @property
    def readings(self) -> tuple[Reading, ...]:
        return self.size, self.direction

    def combined(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The size with its sign (n,)."""
        size, direction = values
        sign = 1.0 * (direction == self.positive) - 1.0 * (direction == self.negative)
        return np.where(np.isfinite(direction), sign * size, np.nan)

    @property
    def label(self) -> str:
        return f"{self.size.label} by {self.direction.label}"


Source = Column | TopicField | Sum | Directed
AnySource = Annotated[
    Annotated[Column, Tag("<Column>")]
    | Annotated[TopicField, Tag("<TopicField>")]
    | Annotated[Sum, Tag("<Sum>")]
    | Annotated[Directed, Tag("<Directed>")],
    _NO_KIND,
]


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
    """Sources of one joint's position, and of its force or the pressures of its cylinder.

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
        names = (name for name in JointSources.model_fields if name != "cylinder")
        sources = {name: getattr(self, name) for name in names}
        return {name: source for name, source in sources.items() if source}


class ColumnMap(Schema):
    """Which column of a table, or which field of a topic, holds which quantity.

    A map is usually read from YAML (`crane_model.configuration.load`). Invalid maps raise
    `pydantic.ValidationError`, or `ConfigurationError` if they are read from a file.

    Parameters
    ----------
    joints : dict of str to JointSources
        Sources of each joint, by its name.
    time : Column, optional
        Time column of tables.
    rate : float, optional
        Sampling rate of tables without time [Hz].
    separator, decimal : str
        Separator and decimal sign of text tables.
    slew_position, supply_pressure, tank_pressure, temperature : Column or TopicField, optional
        Quantities that belong to no joint.

    Examples
    --------
    >>> angle, torque = {"column": "q", "unit": "deg"}, {"column": "tau", "unit": "N m"}
    >>> column_map = ColumnMap(joints={"axis": {"position": angle, "force": torque}}, rate=100.0)
    >>> column_map.joints["axis"].position.quantity
    'angle'
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
        kinds = {type(reading) for reading in self.readings()}
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
        first, given = next((name, _quantities(sources)) for name, sources in self.joints.items())
        for joint, sources in self.joints.items():
            if different := given ^ _quantities(sources):
                raise ValueError(
                    f"{', '.join(sorted(different))}: given for only one of the joints '{first}' "
                    f"and '{joint}'; give it for all joints or for none"
                )
        return self

    @property
    def of_topics(self) -> bool:
        return any(isinstance(reading, TopicField) for reading in self.readings())

    def shared(self) -> dict[str, Source]:
        """Sources that belong to no joint, by quantity."""
        sources = {name: getattr(self, name) for name in SHARED_QUANTITIES}
        return {name: source for name, source in sources.items() if source}

    @property
    def types(self) -> dict[str, str]:
        """Message types by topic, where the map states them."""
        fields = (reading for reading in self.readings() if isinstance(reading, TopicField))
        return {reading.topic: reading.type for reading in fields if reading.type}

    def of(self, joints: Sequence[str], recording: Path | str) -> list[JointSources]:
        """Sources of `joints`; `DataError` names `recording` and each missing source."""
        if unknown := [joint for joint in joints if joint not in self.joints]:
            raise DataError(
                f"{recording}: the column map has no joint '{unknown[0]}'; it has "
                f"{', '.join(self.joints)}; add it, or rename the joints of the model"
            )
        return [self.joints[joint] for joint in joints]

    def cells(self, joints: Sequence[str], recording: Path | str) -> dict[str, list[Cell]]:
        """Sources to read for `joints`, by stream."""
        of_joints = [
            source for joint in self.of(joints, recording) for source in joint.given().values()
        ]
        cells: dict[str, dict[Cell, None]] = {}
        for source in (*of_joints, *self.shared().values()):
            for reading in source.readings:
                cells.setdefault(reading.stream, {})[reading.cell] = None
        return {stream: list(numbers) for stream, numbers in cells.items()}

    def readings(self) -> Iterator[Reading]:
        """All that it names but the time."""
        for sources in (self.shared(), *(sources.given() for sources in self.joints.values())):
            for source in sources.values():
                yield from source.readings


def _quantities(sources: JointSources) -> set[str]:
    return {*sources.given(), *(["force"] if sources.cylinder else [])}
