"""Terms whose model form is a nonparametric curve: values at knots, straight lines between.

Such a term has the signature of an effect, that is what its force depends on and with which
symmetry, and leaves the dependence free. It stands for the effect if none of its formulas fits.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.friction import on_pads, pressing
from crane_model.terms.joint_term import MemoryTerm, OneJointTerm
from crane_model.terms.term import NonparametricCurve, Parameter, Setting, Variable

NONPARAMETRIC_TERMS: dict[str, type["NonparametricTerm"]] = {}
"""The term that gives the curve of a type of term."""

FACTORS: dict[str, Callable[[Record, int], Array]] = {
    "1": lambda record, j: np.ones(len(record)),
    "q'": lambda record, j: record.velocity[:, j],
    "q'|q'|": lambda record, j: record.velocity[:, j] * np.abs(record.velocity[:, j]),
    "sgn(q')": lambda record, j: record.direction[:, j],
}
"""Factors of a curve: (n,) of joint number j."""


class NonparametricTerm(OneJointTerm):
    """sum_k f_k B_k(x) g: B-splines of degree one in a variable x of the joint, times factors g.

    f_k is the value at knot k; beyond the outermost knots the shape stays as it is there or, of a
    shape that is `straight`, goes on as between the last two. A subclass says what x and g are
    (`variable`, `times`), what the values at a knot are (`symbols`, one for each factor, with
    {knot} for its number), which of the `knots` have a value (`kept`; at the others the shape is 0,
    because the model has what they would stand for), and how knots are spaced within the range of
    x, 0 to 1 (`spacing`). `draws` names the types of the laws whose shape it is, and `said` puts
    their signature in words. Where laws of one signature differ in how they bend, `families` has
    the curves (knots, m) of each over the knots, the last of which is at 1, `falling` those whose
    force falls and is straight from the knot `straight_from` on, `slope_of` and `height_of` the
    types of the terms that hold the slope of the shape and its height at rest.
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

    knots: tuple[float, ...]

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        NONPARAMETRIC_TERMS.update(dict.fromkeys(cls.draws, cls))

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
    def followed(cls, record: Record, j: int) -> Array:
        """x (n,) of joint number j."""
        match cls.variable:
            case "position":
                return record.position[:, j]
            case "velocity":
                return np.abs(record.velocity[:, j])
            case "time":
                return record.time
        raise NotImplementedError(f"{cls.__name__}: what {cls.variable} is")

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        """g (n, m) of joint number j."""
        return np.stack([FACTORS[factor](record, j) for factor in self.times], axis=1)

    def values_at_knot(self, k: int, coordinate: str, force: str) -> tuple[Parameter, ...]:
        """The m parameters of a knot, given the units of the joint's coordinate and force."""
        number = {"knot": k + 1}
        return tuple(
            symbol.in_units(coordinate, force)._replace(
                name=symbol.name.format(**number), meaning=symbol.meaning.format(**number)
            )
            for symbol in self.symbols
        )

    @classmethod
    def family_of(cls, law: str, knots: Array) -> Array:
        """Values (parameters, m) of a law's curves at the kept knots; 0 at both ends."""
        curves = cls.families[law](knots / knots[-1])
        line = (knots - knots[0]) / (knots[-1] - knots[0])
        beside = curves - curves[0] - np.outer(line, curves[-1] - curves[0])
        kept: Array = beside[list(cls.kept)]
        return kept

    def curves(self, values: Array) -> tuple[NonparametricCurve, ...]:
        shapes = np.zeros((len(self.times), len(self.knots)))
        shapes[:, self.kept] = values.reshape(len(self.kept), len(self.times)).T
        pairs = zip(shapes, self.times, strict=True)
        return tuple(
            NonparametricCurve(self.variable, self.knots, shape, times) for shape, times in pairs
        )

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        units = setting.units[self.joint], setting.force_unit(self.joint)
        return tuple(parameter for k in self.kept for parameter in self.values_at_knot(k, *units))

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        splines = hats(self.followed(record, j), self.knots, self.straight)[:, self.kept]
        columns = splines[:, :, np.newaxis] * self.factors(record, setting, j)[:, np.newaxis, :]
        return columns.reshape(len(record), -1)


def rounded(knots: Array) -> tuple[float, ...]:
    """To four digits of their range."""
    digits = 4 - int(np.ceil(np.log10(max(float(np.ptp(knots)), np.finfo(float).tiny))))
    return tuple((np.round(knots, digits) + 0.0).tolist())  # no -0.0


def hats(x: Array, knots: tuple[float, ...], straight: bool = False) -> Array:
    """B-splines of degree one (n, k), constant beyond the outermost knots, or `straight` on."""
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


def dry_friction(symbol: str) -> tuple[Parameter, ...]:
    """The value at a knot of a curve of dry friction."""
    meaning = "friction at knot {knot} beyond that of the model"
    return (Parameter(f"{symbol}_{{knot}}", "{force}", None, meaning),)


class NonparametricDryFriction(NonparametricTerm):
    """f(x) sgn(q'): a shape of dry friction."""

    family = "friction"
    times = ("sgn(q')",)


class NonparametricSpeedFriction(NonparametricDryFriction):
    """f(|q'|) sgn(q') beside Coulomb and viscous friction: 0 at rest and at the fastest.

    All of its laws are bent upwards: Stribeck friction where it falls, at low speeds, a loss above.
    """

    type: Literal["nonparametric_speed_friction"] = "nonparametric_speed_friction"
    said = "friction that follows the speed, the same in both directions"
    draws = ("stribeck", "viscous_quadratic")
    variable = "velocity"
    spacing = (*(0.0, 0.02, 0.04, 0.07, 0.12, 0.2), *(0.32, 0.47, 0.63, 0.81, 1.0))
    kept = tuple(range(1, 10))
    straight = True
    families = {"stribeck": dying_out, "viscous_quadratic": growing}
    falling = ("stribeck",)
    straight_from = 5
    slope_of = "viscous"
    height_of = "coulomb"
    symbols = dry_friction("f_speed")

    knots: tuple[float, ...] = Field(examples=[tuple(0.01 * k * k for k in range(11))])


class NonparametricPositionFriction(NonparametricDryFriction):
    """f(q) sgn(q') beside Coulomb friction: 0 at the lower end."""

    type: Literal["nonparametric_position_friction"] = "nonparametric_position_friction"
    said = "friction that follows the position, the same in both directions"
    draws = ("position_friction", "cyclic_friction")
    variable = "position"
    spacing = tuple(k / 8 for k in range(9))
    kept = tuple(range(1, 9))
    symbols = dry_friction("f_place")

    knots: tuple[float, ...] = Field(examples=[tuple(-2.5 + 0.25 * k for k in range(9))])


class NonparametricPadFriction(NonparametricTerm):
    """f(q4) g |cos psi| sgn(q'): pads whose load follows the extension in some other way."""

    type: Literal["nonparametric_pad_friction"] = "nonparametric_pad_friction"
    family = "friction"
    said = "friction that follows the inclination and the extension of the telescope"
    draws = ("pad_friction",)
    variable = "position"
    spacing = tuple(k / 5 for k in range(6))
    kept = tuple(range(6))
    times = ("g |cos psi| sgn(q')",)
    symbols = (
        Parameter(
            "pad_load_{knot}",
            "kg",
            None,
            "friction coefficient times load of the pads at knot {knot}",
        ),
    )

    knots: tuple[float, ...] = Field(examples=[tuple(0.3 * k for k in range(6))])

    def factors(self, record: Record, setting: Setting, j: int) -> Array:
        pressed = pressing(on_pads(self, setting), record)
        return (pressed * record.direction[:, j])[:, np.newaxis]

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        on_pads(self, setting)
        return super().joint_parameters(setting)


class NonparametricLoadFriction(NonparametricDryFriction):
    """f(tau sgn(q')) sgn(q') beside Coulomb friction: 0 at both ends.

    The measured force holds friction: |load + F sgn(q')|. Over the force against the motion, load
    sgn(q') + F, the load itself shows as well, |tau sgn(q') - F|, whatever friction F is.
    """

    type: Literal["nonparametric_load_friction"] = "nonparametric_load_friction"
    said = "friction that follows the load, the same in both directions"
    draws = ("load_friction", "weight_friction")
    holds = ("pressure_gain", "linkage_scale")  # a line: tau itself
    variable = "force against the motion"
    spacing = tuple(k / 10 for k in range(11))
    kept = tuple(range(1, 10))
    straight = True
    symbols = dry_friction("f_load")

    knots: tuple[float, ...] = Field(examples=[tuple(-2000.0 + 400.0 * k for k in range(11))])

    @classmethod
    def followed(cls, record: Record, j: int) -> Array:
        return _load(record, j) * record.direction[:, j]

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """(1 + s)/2 B_k(tau) - (1 - s)/2 B_k(-tau), s = sgn(q'), between both if it sticks."""
        load, s = _load(record, j), record.direction[:, j, np.newaxis]
        ahead, back = (
            hats(force, self.knots, self.straight)[:, self.kept] for force in (load, -load)
        )
        columns: Array = 0.5 * (1.0 + s) * ahead - 0.5 * (1.0 - s) * back
        return columns


def _load(record: Record, j: int) -> Array:
    return record.needed("force", "a shape of friction over the load")[:, j]


class NonparametricWarmUp(NonparametricTerm):
    """f(t) q' beside viscous friction: 0 at the end of the session, when the oil is warm."""

    type: Literal["nonparametric_warm_up"] = "nonparametric_warm_up"
    family = "friction"
    said = "viscous friction that follows the time of the session"
    draws = ("warm_up", "temperature_viscosity")
    variable = "time"
    spacing = (0.0, 0.03, 0.08, 0.16, 0.3, 0.55, 1.0)
    kept = (0, 1, 2, 3, 4, 5)
    times = ("q'",)
    symbols = (
        Parameter(
            "f_time_{knot}",
            "{force} s/{coordinate}",
            None,
            "viscous friction at knot {knot} beyond that of warm oil",
        ),
    )

    knots: tuple[float, ...] = Field(examples=[(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)])

    @classmethod
    def over(cls, x: Array) -> tuple[float, ...]:
        if not len(x):
            raise ValueError("knots: no sample to lay them over")
        return rounded(np.quantile(x, cls.spacing))


class NonparametricPositionForce(NonparametricTerm):
    """f(q), at q' of either sign, beside a constant force: 0 at the lower end."""

    type: Literal["nonparametric_position_force"] = "nonparametric_position_force"
    family = "elasticity"
    said = "a force that follows the position, whatever the motion"
    draws = ("hose_stiffness",)
    variable = "position"
    spacing = tuple(k / 8 for k in range(9))
    kept = tuple(range(1, 9))
    times = ("1",)
    symbols = (
        Parameter(
            "k_place_{knot}", "{force}", None, "force at knot {knot} beyond that at the lower end"
        ),
    )

    knots: tuple[float, ...] = Field(examples=[tuple(-2.5 + 0.25 * k for k in range(9))])


class NonparametricEndDamping(NonparametricTerm):
    """(f(q) + h(q) |q'|) q' near both ends of the range that was moved through: 0 between."""

    type: Literal["nonparametric_end_damping"] = "nonparametric_end_damping"
    family = "hydraulics"
    said = "resistance to motion near the ends of the range"
    draws = ("end_cushioning",)
    variable = "position"
    spacing = (0.0, 0.05, 0.11, 0.2, 0.8, 0.89, 0.95, 1.0)
    kept = (0, 1, 2, 5, 6, 7)
    times = ("q'", "q'|q'|")
    symbols = (
        Parameter(
            "f_end_{knot}", "{force} s/{coordinate}", None, "viscous resistance at knot {knot}"
        ),
        Parameter(
            "h_end_{knot}", "{force} s2/{coordinate}2", None, "turbulent resistance at knot {knot}"
        ),
    )

    knots: tuple[float, ...] = Field(examples=[(-2.5, -2.25, -2.0, -1.75, -1.2, -1.0, -0.7, -0.3)])


class RelaxingForce(MemoryTerm, OneJointTerm):
    """sum_i k_i z_i, z_i' = q' - z_i/time_i: springs behind dampers, whose force fades at rest.

    A force that follows the position for a while and then forgets it is no hose of `k q` and no
    friction: it has a signature, and no effect of the catalogue has it.
    """

    type: Literal["relaxing_force"] = "relaxing_force"
    family = "elasticity"
    unlisted_signature = "a force that follows the position and fades within seconds"

    times: tuple[float, ...] = Field(default=(0.3, 1.0, 3.0, 9.0), min_length=1)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        unit = f"{setting.force_unit(self.joint)}/{setting.units[self.joint]}"
        return tuple(
            Parameter(f"k_fading_{i + 1}", unit, None, f"stiffness that fades within {time:g} s")
            for i, time in enumerate(self.times)
        )

    def start(self, record: Record, setting: Setting) -> Array:
        return np.zeros((len(record), len(self.times)))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step of constant velocity."""
        j, step = before.column(self.joint), after.time - before.time
        displacement = after.position[:, j] - before.position[:, j]
        share = step[:, np.newaxis] / np.array(self.times)
        kept = np.exp(-share)
        moved: Array = states * kept + displacement[:, np.newaxis] * (1.0 - kept) / share
        return moved

    def trace(self, record: Record, setting: Setting) -> Array:
        q = record.position[:, record.column(self.joint)]
        displacement = np.diff(q, prepend=q[:1])
        step = np.diff(record.time, prepend=record.time[:1])
        return _traced(displacement, step, np.array(self.times), record.first_of_run)

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.states(record, setting)


@njit(cache=True)
def _traced(displacement: Array, step: Array, times: Array, first: Flags) -> Array:
    z = np.zeros((len(displacement), len(times)))
    for k in range(1, len(displacement)):
        if not first[k]:
            for i in range(len(times)):
                share = step[k] / times[i]
                kept = np.exp(-share)
                z[k, i] = z[k - 1, i] * kept + displacement[k] * (1.0 - kept) / share
    return z
