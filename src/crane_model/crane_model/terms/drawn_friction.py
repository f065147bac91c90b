"""Shapes of friction: over the speed, the position, the load and the time."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.friction import on_pads, pressing
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import DrawnCurve, Family, Parameter, Setting, Variable

# Terms whose law is no formula but a shape: values at knots, and straight lines between them.
#
# A drawn term has the signature of an effect, which is what its force depends on and with which
# symmetry, and leaves the dependence free. It stands for that effect where no law of it fits.

DRAWING: dict[str, type["DrawnTerm"]] = {}
"""The term that draws the law of a type of term."""


class DrawnTerm(OneJointTerm):
    """sum_k f_k B_k(x) g: B-splines of degree one in a variable x of the joint, times factors g.

    f_k is the value at knot k; beyond the outermost knots the shape stays as it is there or, of a
    shape that is `straight`, goes on as between the last two. A subclass says what x and g are
    (`variable`, `times`), which of the `knots` have a value (`kept`; at the others the shape is 0,
    because the model has what they would stand for), and how knots are spaced within the range of
    x, 0 to 1 (`spacing`). `draws` names the types of the laws whose shape it is, and `said` puts
    their signature in words. Where laws of one signature differ in how they bend, `families` has
    the curves (knots, m) of each over the knots, the last of which is at 1, `falling` those whose
    force falls and is straight from the knot `straight_from` on, `slope_of` and `height_of` the
    types of the terms that hold the slope of the shape and its height at rest. Where every law of
    the signature `rises` with x, the shape is 0 at its first knot alone, and has one factor.
    """

    said: ClassVar[str]
    variable: ClassVar[Variable]
    spacing: ClassVar[tuple[float, ...]]
    kept: ClassVar[tuple[int, ...]]
    times: ClassVar[tuple[str, ...]]
    families: ClassVar[Mapping[str, Callable[[Array], Array]]] = {}
    falling: ClassVar[tuple[str, ...]] = ()
    straight_from: ClassVar[int] = 0
    slope_of: ClassVar[str | None] = None
    height_of: ClassVar[str | None] = None
    straight: ClassVar[bool] = False
    rises: ClassVar[bool] = False

    knots: tuple[float, ...]

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        DRAWING.update(dict.fromkeys(cls.draws, cls))

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if len(self.knots) != len(self.spacing):
            raise ValueError(f"knots: {len(self.spacing)} needed, got {len(self.knots)}")
        if not (np.diff(self.knots) > 0.0).all():
            raise ValueError(f"knots: each must exceed the one before, got {list(self.knots)}")
        return self

    @classmethod
    def over(cls, x: Array) -> tuple[float, ...]:
        """The knots for values (n,) of x; `ValueError` if there are none."""
        low, high = float(x.min()), float(x.max())
        return rounded(low + (high - low) * np.array(cls.spacing))

    @classmethod
    @abstractmethod
    def followed(cls, record: Record, j: int) -> Array:
        """x (n,) of joint number j."""

    @abstractmethod
    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """g (n, m) of joint number j."""

    @abstractmethod
    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """The m parameters of a knot, given the units of the joint's coordinate and force."""

    @classmethod
    def family_of(cls, law: str, knots: Array) -> Array:
        """Values (parameters, m) of the curves of a type of law at the kept ones of the knots; they
        are 0 at both ends, as the shape is.
        """
        curves = cls.families[law](knots / knots[-1])
        line = (knots - knots[0]) / (knots[-1] - knots[0])
        beside = curves - curves[0] - np.outer(line, curves[-1] - curves[0])
        kept: Array = beside[list(cls.kept)]
        return kept

    def curves(self, values: Array) -> tuple[DrawnCurve, ...]:
        """One for each factor, with the zeros where no value is kept."""
        shapes = np.zeros((len(self.times), len(self.knots)))
        shapes[:, self.kept] = values.reshape(len(self.kept), len(self.times)).T
        pairs = zip(shapes, self.times, strict=True)
        return tuple(DrawnCurve(self.variable, self.knots, shape, times) for shape, times in pairs)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The values at the knots that have one."""
        units = setting.units[self.joint], setting.force_unit(self.joint)
        return tuple(one for k in self.kept for one in self.values_at_knot(k, *units))

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """B_k(x) g: (n, parameters)."""
        splines = hats(self.followed(record, j), self.knots, self.straight)[:, self.kept]
        columns = splines[:, :, np.newaxis] * self.factors(record, setting, j)[:, np.newaxis, :]
        return columns.reshape(len(record), -1)


def rounded(knots: Array) -> tuple[float, ...]:
    """To four digits of their range."""
    digits = 4 - int(np.ceil(np.log10(max(float(np.ptp(knots)), np.finfo(float).tiny))))
    return tuple((np.round(knots, digits) + 0.0).tolist())  # no -0.0


def hats(x: Array, knots: tuple[float, ...], straight: bool = False) -> Array:
    """B-splines of degree one (n, k): 1 at their own knot, 0 at the others; beyond the outermost
    knots constant, or `straight` on.
    """
    columns: Array = np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=1)
    for last, before in ((0, 1), (-1, -2)) if straight else ():
        step = knots[last] - knots[before]
        beyond = np.maximum((x - knots[last]) / step, 0.0)
        columns[:, last] += beyond
        columns[:, before] -= beyond
    return columns


LOW_SPEED = 0.3
"""Share of the fastest speed up to which the w of the curves below goes."""


def dying_out(speed: Array) -> Array:
    """exp(-(v/w)^d), over speeds v (n,) up to 1: (n, m), its values for several w and d."""
    out_at, exponent = np.meshgrid(np.geomspace(0.01, LOW_SPEED, 16), (0.7, 1.0, 1.5, 2.0, 3.0))
    curves: Array = np.exp(-((speed[:, np.newaxis] / out_at.ravel()) ** exponent.ravel()))
    return curves


def growing(speed: Array) -> Array:
    """max(v - w, 0)^d, in the same way."""
    onset, exponent = np.meshgrid(np.linspace(0.0, LOW_SPEED, 6), (1.2, 1.5, 1.75, 2.0, 2.5, 3.0))
    beyond = np.maximum(speed[:, np.newaxis] - onset.ravel(), 0.0)
    curves: Array = beyond ** exponent.ravel()
    return curves


class DrawnDryFriction(DrawnTerm):
    """f(x) sgn(q'): a shape of dry friction."""

    family: ClassVar[Family] = "friction"
    times: ClassVar[tuple[str, ...]] = ("sgn(q')",)
    symbol: ClassVar[str]

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """sgn(q')."""
        return record.direction[:, j, np.newaxis]

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """One."""
        meaning = f"friction at knot {k + 1} beyond that of the model"
        return (Parameter(f"{self.symbol}_{k + 1}", force, None, meaning),)


class DrawnSpeedFriction(DrawnDryFriction):
    """f(|q'|) sgn(q') beside Coulomb and viscous friction: 0 at rest and at the fastest.

    All of its laws are bent upwards: Stribeck friction where it falls, at low speeds, a loss above.
    """

    type: Literal["drawn_speed_friction"] = "drawn_speed_friction"
    said: ClassVar[str] = "friction that follows the speed, alike in both directions"
    draws: ClassVar[tuple[str, ...]] = ("stribeck", "viscous_quadratic")
    variable: ClassVar[Variable] = "velocity"
    spacing: ClassVar[tuple[float, ...]] = (
        *(0.0, 0.02, 0.04, 0.07, 0.12, 0.2),
        *(0.32, 0.47, 0.63, 0.81, 1.0),
    )
    kept: ClassVar[tuple[int, ...]] = tuple(range(1, 10))
    symbol: ClassVar[str] = "f_speed"
    straight: ClassVar[bool] = True
    families: ClassVar[Mapping[str, Callable[[Array], Array]]] = {
        "stribeck": dying_out,
        "viscous_quadratic": growing,
    }
    falling: ClassVar[tuple[str, ...]] = ("stribeck",)
    straight_from: ClassVar[int] = 5
    slope_of: ClassVar[str | None] = "viscous"
    height_of: ClassVar[str | None] = "coulomb"

    knots: tuple[float, ...] = Field(examples=[tuple(0.01 * k * k for k in range(11))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """|q'|."""
        return np.abs(record.velocity[:, j])


class DrawnPositionFriction(DrawnDryFriction):
    """f(q) sgn(q') beside Coulomb friction: 0 at the lower end."""

    type: Literal["drawn_position_friction"] = "drawn_position_friction"
    said: ClassVar[str] = "friction that follows the position, alike in both directions"
    draws: ClassVar[tuple[str, ...]] = ("position_friction", "cyclic_friction")
    variable: ClassVar[Variable] = "position"
    spacing: ClassVar[tuple[float, ...]] = tuple(k / 8 for k in range(9))
    kept: ClassVar[tuple[int, ...]] = tuple(range(1, 9))
    symbol: ClassVar[str] = "f_place"

    knots: tuple[float, ...] = Field(examples=[tuple(-2.5 + 0.25 * k for k in range(9))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """q."""
        return record.position[:, j]


class DrawnPadFriction(DrawnTerm):
    """f(q4) g |cos psi| sgn(q'): pads whose load follows the extension in some other way."""

    type: Literal["drawn_pad_friction"] = "drawn_pad_friction"
    family: ClassVar[Family] = "friction"
    said: ClassVar[str] = "friction that follows the inclination and the extension of the telescope"
    draws: ClassVar[tuple[str, ...]] = ("pad_friction",)
    variable: ClassVar[Variable] = "position"
    spacing: ClassVar[tuple[float, ...]] = tuple(k / 5 for k in range(6))
    kept: ClassVar[tuple[int, ...]] = tuple(range(6))
    times: ClassVar[tuple[str, ...]] = ("g |cos psi| sgn(q')",)

    knots: tuple[float, ...] = Field(examples=[tuple(0.3 * k for k in range(6))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """q4."""
        return record.position[:, j]

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """g |cos psi| sgn(q4')."""
        pressed = pressing(on_pads(self, setting), record)
        return (pressed * record.direction[:, j])[:, np.newaxis]

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """One."""
        meaning = f"friction coefficient times load of the pads at knot {k + 1}"
        return (Parameter(f"pad_load_{k + 1}", "kg", None, meaning),)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        """The values at the knots, of a telescope."""
        on_pads(self, setting)
        return super().joint_parameters(setting)


class DrawnLoadFriction(DrawnDryFriction):
    """f(tau sgn(q')) sgn(q') beside Coulomb friction: 0 at both ends.

    The measured force holds friction: |load + F sgn(q')|. Over the force against the motion, load
    sgn(q') + F, the load itself shows as well, |tau sgn(q') - F|, whatever friction F is.
    """

    type: Literal["drawn_load_friction"] = "drawn_load_friction"
    said: ClassVar[str] = "friction that follows the load, alike in both directions"
    draws: ClassVar[tuple[str, ...]] = ("load_friction", "weight_friction")
    holds: ClassVar[tuple[str, ...]] = ("pressure_gain", "linkage_scale")  # a line: tau itself
    variable: ClassVar[Variable] = "force against the motion"
    spacing: ClassVar[tuple[float, ...]] = tuple(k / 10 for k in range(11))
    kept: ClassVar[tuple[int, ...]] = tuple(range(1, 10))
    symbol: ClassVar[str] = "f_load"
    straight: ClassVar[bool] = True

    knots: tuple[float, ...] = Field(examples=[tuple(-2000.0 + 400.0 * k for k in range(11))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """tau sgn(q')."""
        return _load(record, j) * record.direction[:, j]

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """(1 + s)/2 B_k(tau) - (1 - s)/2 B_k(-tau), s = sgn(q'): where a joint sticks, friction is
        between what it is either way.
        """
        load, s = _load(record, j), record.direction[:, j, np.newaxis]
        ahead, back = (hats(one, self.knots, self.straight)[:, self.kept] for one in (load, -load))
        columns: Array = 0.5 * (1.0 + s) * ahead - 0.5 * (1.0 - s) * back
        return columns


def _load(record: Record, j: int) -> Array:
    return record.needed("force", "a shape of friction over the load")[:, j]


class DrawnWarmUp(DrawnTerm):
    """f(t) q' beside viscous friction: 0 at the end of the session, when the oil is warm."""

    type: Literal["drawn_warm_up"] = "drawn_warm_up"
    family: ClassVar[Family] = "friction"
    said: ClassVar[str] = "viscous friction that follows the time of the session"
    draws: ClassVar[tuple[str, ...]] = ("warm_up", "temperature_viscosity")
    variable: ClassVar[Variable] = "time"
    spacing: ClassVar[tuple[float, ...]] = (0.0, 0.03, 0.08, 0.16, 0.3, 0.55, 1.0)
    kept: ClassVar[tuple[int, ...]] = (0, 1, 2, 3, 4, 5)
    times: ClassVar[tuple[str, ...]] = ("q'",)

    knots: tuple[float, ...] = Field(examples=[(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)])

    @classmethod
    def over(cls, x: Array) -> tuple[float, ...]:
        """By how many samples are earlier: between recordings nothing is known."""
        if not len(x):
            raise ValueError("knots: no sample to lay them over")
        return rounded(np.quantile(x, cls.spacing))

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        """t."""
        return record.time

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """q'."""
        return record.velocity[:, j, np.newaxis]

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """One."""
        meaning = f"viscous friction at knot {k + 1} beyond that of warm oil"
        return (Parameter(f"f_time_{k + 1}", f"{force} s/{coordinate}", None, meaning),)
