"""Terms of the model, the registry of all of them, and the candidates among them."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.configuration import Schema, load_entry_points, of_type
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.motion_columns import MotionColumn
from crane_model.record import Record

# Loads of single recordings.


class Load(Schema):
    """`runs`, numbers of `Record.run`, that carry one load, and the `recordings` they come from."""

    runs: tuple[int, ...] = Field(min_length=1)
    recordings: tuple[str, ...] = ()


# Properties that make a term a candidate for an effect that a model lacks.

Variable = Literal[
    "position",
    "velocity",
    "acceleration",
    "displacement since the reversal",
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
"""Quantities that the force of an effect may depend on, besides the direction of motion."""


class Effect(NamedTuple):
    """A physical effect as people speak of it."""

    name: str
    signature: str  # how it shows in the residual of a model that lacks it
    confusable: tuple[str, ...]  # types of the terms that it is easily taken for
    discriminated_by: str  # the experiment that tells it from them
    kin: tuple[str, ...] = ()  # types of terms that are other laws of the same effect: one class
    law_of: str = ""  # type of the term that is the usual law of the same effect, if not this one
    follows: tuple[Variable, ...] = ()  # what its force depends on, first that which shows it best
    formless: bool = False  # one factor of what the model has: no law whose form could differ
    usual: float = 0.0  # size of its parameters that any sound machine may have
    largest: float = float("inf")  # size of its parameters, beyond which it is no such effect


class NonparametricCurve(NamedTuple):
    """Values (k,) at knots (k,) of a variable, straight between, to be multiplied by `times`."""

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
        """Place of a value between lowest, 0, and highest, 1."""
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

    def in_units(self, coordinate: str, force: str) -> "Parameter":
        """With the units of a joint where its unit has {coordinate}, {force} or {inertia}."""
        inertia = "kg m2" if coordinate == "rad" else "kg"
        unit = self.unit.format(coordinate=coordinate, force=force, inertia=inertia)
        return self._replace(unit=unit)


class Setting(NamedTuple):
    """Knowledge of a term about its model: units of the joints' coordinates, and the machine."""

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
    `loads` then says which ones carry what. `unlisted_signature` says
    in words what no effect of the catalogue shows: a force that does is not an effect that merely
    resembles it. A nonparametric term names with `draws` the types of terms whose curve it is, and
    with `holds` those that it is at some shape.
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
    unlisted_signature: ClassVar[str] = ""
    draws: ClassVar[tuple[str, ...]] = ()
    holds: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            REGISTRY[name] = cls

    @classmethod
    def has_inertia(cls) -> bool:
        """Return whether it belongs to the bodies themselves, as (7) has them."""
        return cls.family == "rigid body"

    @classmethod
    def has_weight(cls) -> bool:
        """Return whether its force at rest is the work of gravity."""
        return cls.family in ("rigid body", "gravity and load")

    @classmethod
    def is_friction(cls) -> bool:
        """Return whether it takes energy from the motion, as (13) does."""
        return cls.family == "friction"

    @classmethod
    def is_of_sensors(cls) -> bool:
        """Return whether it is in the readings of sensors, and not in the machine."""
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
        """Return whether it belongs to single recordings, and not to the machine."""
        return False

    @property
    def carried(self) -> tuple[Load, ...]:
        """Loads of single recordings; empty if none differs."""
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
        """The term without parts that recordings do not show, by `shown` (parameters,)."""
        return self

    def curves(self, values: Array) -> tuple[NonparametricCurve, ...]:
        """The law as these parameters (p,) draw it; none where it is a formula."""
        return ()

    def of_bodies(self, setting: Setting) -> Array | None:
        """(parameters, 10 m) from the bodies' ten; None if it does not follow from them."""
        return None

    @property
    def zero_moments(self) -> tuple[str, ...]:
        """Which of the ten parameters of single bodies it takes to be zero, as mx.telescope."""
        return ()

    def motion_columns(self, setting: Setting) -> tuple[MotionColumn, ...]:
        """Its columns, where all are proportional to what single joints do; else none."""
        return ()

    def turned_by(self, setting: Setting) -> Mapping[str, float]:
        """Joints, with their shares of a speed whose sign the term follows, if of several."""
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


GROUP = "crane_model.terms"


def load_installed() -> tuple[type[Term], ...]:
    """Register the terms of every installed package with an entry point of `GROUP`."""
    return load_entry_points(GROUP, REGISTRY, "a term")


def load_terms(path: Path | str) -> tuple[type[Term], ...]:
    """Register the terms that a Python file defines, for model files, and as candidates.

    The file is imported under its name, and its folder stays on the path, so that other processes
    import it, too. `ConfigurationError` if it cannot be, defines none, or takes a type that exists.
    """
    path = Path(path).resolve()
    if path.suffix != ".py" or not path.is_file():
        raise ConfigurationError(f"{path}: no such Python file (.py); check the path")
    before = dict(REGISTRY)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        module = import_module(path.stem)
    except Exception as error:  # whatever stands in the file
        raise ConfigurationError(f"{path}: {type(error).__name__}: {error}") from error
    if module.__file__ is None or Path(module.__file__).resolve() != path:
        raise ConfigurationError(
            f"{path}: '{path.stem}' is also the name of {module.__file__ or 'a module of Python'}; "
            "rename the file"
        )
    taken = [name for name, term in before.items() if REGISTRY[name] is not term]
    REGISTRY.update(before)
    if taken:
        raise ConfigurationError(
            f"{path}: there is a term of type '{taken[0]}' already; choose another type"
        )
    terms = tuple(term for term in REGISTRY.values() if term.__module__ == path.stem)
    if not terms:
        raise ConfigurationError(
            f"{path}: defines no term; derive a class from crane_model.terms.JointTerm"
        )
    return terms


def candidates(setting: Setting) -> list[type[Term]]:
    """Terms with an `effect` that a model of this setting can hold, in the order of their types."""
    return [cls for cls in _sorted() if cls.effect is not None and _held(cls, setting)]


def nuisances(setting: Setting) -> list[type[Term]]:
    """Terms that stand for errors of the data and that a model of this setting can hold."""
    return [cls for cls in _sorted() if cls.nuisance and _held(cls, setting)]


def unlisted_signatures(setting: Setting, joint: str) -> list[Term]:
    """On a joint, the signatures that no effect has."""
    return [
        typical(cls, joint)
        for cls in _sorted()
        if cls.unlisted_signature and joint in joints_of(cls, setting)
    ]


def joints_of(cls: type[Term], setting: Setting) -> tuple[str, ...]:
    """The joints on which the term can act; empty for a term of the whole machine."""
    return tuple(
        joint
        for joint in cls.places(setting)
        if joint is not None and _accepted(cls, setting, joint)
    )


def typical(cls: type[Term], joint: str | None = None) -> Term:
    """The term with each shape parameter in the middle of its range, on `joint` if it has one.

    Constants that a model must give are those of their examples.
    """
    given = {name: field.examples[0] for name, field in cls.model_fields.items() if field.examples}
    shapes: dict[str, Any] = {
        field: float(shape.grid[shape.points // 2]) for field, shape in cls.shapes.items()
    }
    return cls(**given, **shapes, **({} if joint is None else {"joint": joint}))


def _sorted() -> list[type[Term]]:
    return [REGISTRY[name] for name in sorted(REGISTRY)]


def _held(cls: type[Term], setting: Setting) -> bool:
    return any(_accepted(cls, setting, joint) for joint in cls.places(setting))


def _accepted(cls: type[Term], setting: Setting, joint: str | None) -> bool:
    try:
        typical(cls, joint).parameters(setting)
    except ConfigurationError:
        return False
    return True
