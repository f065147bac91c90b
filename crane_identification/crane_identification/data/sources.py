"""What a column map names: columns of tables, fields of topics, and sums of them."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from crane_identification.data.units import UNITS
from crane_model.configuration import Schema

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
        """What the unit measures."""
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
        """Where the numbers come from with their time: a pattern of file names, or a topic."""

    @property
    @abstractmethod
    def cell(self) -> Cell:
        """Which number of a row or message."""

    @property
    @abstractmethod
    def label(self) -> str:
        """How messages speak of it."""

    def in_si(self, numbers: np.ndarray) -> np.ndarray:
        """The quantity in SI units."""
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
        """Pattern of file names."""
        return self.file

    @property
    def cell(self) -> Cell:
        """Column, and column of a matrix."""
        return self.column, self.index

    @property
    def label(self) -> str:
        """The name of the column."""
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
        """The topic that its messages come on."""
        return self.topic

    @property
    def cell(self) -> Cell:
        """Field and place in it."""
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
    kinds = {
        "column": "<Column>",
        "topic": "<TopicField>",
        "sum": "<Sum>",
        "size": "<Directed>",
    }
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
        if len({one.quantity for one in self.sum}) > 1:
            units = ", ".join(one.unit for one in self.sum)
            raise ValueError(f"a sum of different quantities, in {units}; give units of one")
        return self

    @property
    def quantity(self) -> str:
        """What it is a sum of."""
        return self.sum[0].quantity

    @property
    def unit(self) -> str:
        """The unit of the first."""
        return self.sum[0].unit

    @property
    def readings(self) -> tuple[Reading, ...]:
        """What is added."""
        return self.sum

    def combined(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The sum (n,)."""
        return np.asarray(np.sum(values, axis=0))

    @property
    def label(self) -> str:
        """All of them."""
        first, *others = self.sum
        signs = ["-" if one.scale < 0 else "+" for one in others]
        return " ".join(
            [first.label, *(f"{s} {o.label}" for s, o in zip(signs, others, strict=True))]
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
        """That of the size."""
        return self.size.quantity

    @property
    def unit(self) -> str:
        """That of the size."""
        return self.size.unit

    @property
    def readings(self) -> tuple[Reading, ...]:
        """Size and direction."""
        return self.size, self.direction

    def combined(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The size with its sign (n,)."""
        size, direction = values
        sign = 1.0 * (direction == self.positive) - 1.0 * (direction == self.negative)
        return np.where(np.isfinite(direction), sign * size, np.nan)

    @property
    def label(self) -> str:
        """Size and direction."""
        return f"{self.size.label} by {self.direction.label}"


Source = Column | TopicField | Sum | Directed
AnySource = Annotated[
    Annotated[Column, Tag("<Column>")]
    | Annotated[TopicField, Tag("<TopicField>")]
    | Annotated[Sum, Tag("<Sum>")]
    | Annotated[Directed, Tag("<Directed>")],
    _NO_KIND,
]
