"""Terms whose law is no formula but a shape: values at knots, and straight lines between them.

A drawn term has the signature of an effect, which is what its force depends on and with which
symmetry, and leaves the dependence free. It stands for that effect where no law of it fits.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from crane_model.array import Array
from crane_model.record import Record
from crane_model.terms.effect import DrawnCurve, Variable
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Parameter, Setting

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
