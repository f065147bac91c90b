"""What a term of the model is, and the registry of all of them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.configuration import Schema
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn
from crane_model.record import Record
from crane_model.registry import of_type

# What single recordings carry.


class Load(Schema):
    """`runs`, numbers of `Record.run`, that carry one load, and the `recordings` they come from."""

    runs: tuple[int, ...] = Field(min_length=1)
    recordings: tuple[str, ...] = ()


# What makes a term a candidate for an effect that a model lacks.

Variable = Literal[
    "position",
    "velocity",
    "acceleration",
    "way since it turned",
    "force",
    "force against the motion",
    "rate of the force",
    "lead",
    "pressure sum",
    "pressure of chamber B",
    "extension of the telescope",
    "inclination of the telescope",
    "slew velocity",
    "temperature",
    "time",
    "recording",
]
"""What the force of an effect may depend on, beside the direction of motion."""


class Effect(NamedTuple):
    """A physical effect as people speak of it."""

    name: str
    signature: str  # how it shows in the residual of a model that lacks it
    confusable: tuple[str, ...]  # types of the terms that it is easily taken for
    settled_by: str  # the experiment that tells it from them
    kin: tuple[str, ...] = ()  # types of terms that are other laws of the same effect: one class
    law_of: str = ""  # type of the term that is the usual law of the same effect, if not this one
    follows: tuple[Variable, ...] = ()  # what its force depends on, first that which shows it best
    formless: bool = False  # one factor of what the model has: no law whose form could differ
    usual: float = 0.0  # size of its parameters that any sound machine may have
    largest: float = float("inf")  # size of its parameters, beyond which it is no such effect


class DrawnCurve(NamedTuple):
    """A law that is drawn: values (k,) at knots (k,) of a variable, to be multiplied by `times`."""

    variable: Variable
    knots: tuple[float, ...]
    values: Array
    times: str


class Shape(NamedTuple):
    """A field of a term in which its force is not linear, and where its value is sought.

    Values are tried in equal ratios or, where that is what changes the force evenly, `even` steps.
    """

    lowest: float
    highest: float
    unit: str
    points: int
    meaning: str
    even: bool = False

    @property
    def grid(self) -> Array:
        """(points,) from lowest to highest."""
        return self.spread(self.points)

    def spread(self, points: int) -> Array:
        """(points,) values from lowest to highest."""
        return (np.linspace if self.even else np.geomspace)(self.lowest, self.highest, points)

    def unit_on(self, coordinate: str) -> str:
        """The unit on a joint of this coordinate, rad or m; those of both kinds are given."""
        both = self.unit.split(" or ")
        return both[-1] if coordinate == "m" else both[0]

    def share(self, value: float) -> float:
        """Where a value lies between lowest, 0, and highest, 1."""
        if self.even:
            return (value - self.lowest) / (self.highest - self.lowest)
        return float(np.log(value / self.lowest) / np.log(self.highest / self.lowest))

    def value(self, share: float) -> float:
        """The value at that `share`, which is kept from 0 to 1."""
        share = min(max(share, 0.0), 1.0)
        if self.even:
            return self.lowest + share * (self.highest - self.lowest)
        return float(self.lowest * (self.highest / self.lowest) ** share)


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

    What else its physics is, the class says as well, so that nobody has to know classes by name:
    `has_base_parameters` if its parameters are those of (8), `asymmetry_of` the type of the term
    whose difference between two directions of motion it is, `of_one_instant` if its columns follow
    from the motion at the same instant, `carries_loads` if recordings may differ in it: a field
    `loads` then says which ones carry what. A `stranger` is a signature that no effect of the
    catalogue has, in words: a force that shows it is no effect that merely resembles it. A term
    whose law is a shape says with `draws` of which types of terms it is the law, and with `holds`
    which others it is at some shape. `former` are parameters that it had under an earlier law, each
    with what is now in its place: model files that give values of these must be fitted anew.
    """

    type: str
    family: ClassVar[Family]
    effect: ClassVar[Effect | None] = None
    nuisance: ClassVar[bool] = False
    shapes: ClassVar[Mapping[str, Shape]] = MappingProxyType({})
    of_model: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({})
    has_base_parameters: ClassVar[bool] = False
    asymmetry_of: ClassVar[str | None] = None
    of_one_instant: ClassVar[bool] = False
    carries_loads: ClassVar[bool] = False
    stranger: ClassVar[str] = ""
    draws: ClassVar[tuple[str, ...]] = ()
    holds: ClassVar[tuple[str, ...]] = ()
    former: ClassVar[Mapping[str, str]] = MappingProxyType({})

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            REGISTRY[name] = cls

    @classmethod
    def has_inertia(cls) -> bool:
        """Whether it is of the bodies themselves, as (7) has them."""
        return cls.family == "rigid body"

    @classmethod
    def has_weight(cls) -> bool:
        """Whether what it asks for at rest is the work of gravity."""
        return cls.family in ("rigid body", "gravity and load")

    @classmethod
    def is_friction(cls) -> bool:
        """Whether it takes energy from the motion, as (13) does."""
        return cls.family == "friction"

    @classmethod
    def is_of_sensors(cls) -> bool:
        """Whether it is in what sensors show, and not in the machine."""
        return cls.family == "sensing"

    @classmethod
    def places(cls, setting: Setting) -> tuple[str | None, ...]:
        """The joints on which such a term could act alone; None stands for the whole machine."""
        return (None,)

    @property
    def only_joint(self) -> str | None:
        """The joint on which alone it acts; None for a term of the whole machine."""
        return None

    @property
    def of_recordings(self) -> bool:
        """Whether it says what single recordings carried, which is no property of the machine."""
        return False

    @property
    def carried(self) -> tuple[Load, ...]:
        """What single recordings carry; nothing where none differs."""
        return ()

    @abstractmethod
    def parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """Name, unit, sign of each parameter; `ConfigurationError` if the model cannot hold it."""

    @abstractmethod
    def fill(self, record: Record, setting: Setting, columns: Array) -> None:
        """Write the regressor columns on n samples of j joints, SI units.

        `columns` (n, j, parameters) comes as zeros, a part of the regressor of the whole model.
        """

    def showing(self, shown: Flags) -> Self:
        """The term without parts that recordings do not show: `shown` (parameters,) says which of
        its columns they do. One whose parts belong together stays as it is.
        """
        return self

    def curves(self, values: Array) -> tuple[DrawnCurve, ...]:
        """The law as these parameters (p,) draw it; none where it is a formula."""
        return ()

    def of_bodies(self, setting: Setting) -> Array | None:
        """(parameters, 10 m) from the ten of each body of the machine (`crane_model.chain`) to its
        parameters; None where they do not follow from the bodies.
        """
        return None

    @property
    def zero_moments(self) -> tuple[str, ...]:
        """Which of the ten parameters of single bodies it takes to be zero, as mx.telescope."""
        return ()

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """Its columns, where all are proportional to what single joints do; else none."""
        return ()

    def turned_by(self, setting: Setting) -> Mapping[str, float]:
        """Joints, with their shares of a speed whose sign the term follows; none where that is of
        single joints.
        """
        return {}

    def pull_back(self, record: Record, setting: Setting, weight: Array) -> Array | None:
        """(3, n, j): derivatives of its columns, summed with weights (n, j, parameters), with
        respect to q, q' and q''. None if there is no closed form; not asked for `motion_columns`.
        """
        return None

    def start(self, record: Record, setting: Setting) -> Array:
        """States (n, s) of n runs that begin at the samples of the record; s = 0: no memory."""
        return np.empty((len(record), 0))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """States (n, s) of n runs one step on; the records hold the two ends of the step."""
        return states

    def trace(self, record: Record, setting: Setting) -> Array:
        """States (n, s) at each sample of a recording."""
        return self.start(record, setting)

    def needed(self, record: Record, signal: str) -> Array:
        """A signal of the record that not every recording has; `DataError` if it is missing."""
        return record.needed(signal, f"term '{self.type}'")

    def columns(self, record: Record, setting: Setting) -> Array:
        """The regressor columns by themselves: (n, j, parameters), SI units."""
        columns = np.zeros((*record.position.shape, len(self.parameters(setting))))
        self.fill(record, setting, columns)
        return columns


def term_from_mapping(content: Mapping[str, Any]) -> Term:
    """The term that an entry of a model file describes; raises ValueError as pydantic wants it."""
    more = "those of installed packages and of --terms FILE"
    return of_type(content, REGISTRY, "term", more)
