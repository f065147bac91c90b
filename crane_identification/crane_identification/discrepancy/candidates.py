"""The effects that a model may lack: every candidate term, on every joint, at every shape."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from crane_identification.discrepancy.evidence import Evidence
from crane_identification.progress import Progress, silent
from crane_model.errors import CraneError
from crane_model.model_file import Model
from crane_model.terms import Effect, Shape, Term, candidates, joints_of

WHOLE = "all"  # in place of a joint
LARGEST_GRID = 16  # shapes of a family; between them, the best is refined


@dataclass(frozen=True)
class Family:
    """An effect on one joint, or on the whole machine (`joint` is None), at any shape.

    `runs`: the sets of runs in which it may be, for a term that has them as a field.
    """

    term: type[Term]
    joint: str | None
    runs: tuple[tuple[int, ...], ...] = ()

    @property
    def effect(self) -> Effect:
        """What people call it."""
        assert self.term.effect is not None  # candidates have one
        return self.term.effect

    @property
    def shapes(self) -> Mapping[str, Shape]:
        """The shape parameters that are sought."""
        return self.term.shapes

    @property
    def changes(self) -> bool:
        """Whether it is a change of what the model has, and not an effect that it lacks."""
        return False

    @property
    def type(self) -> str:
        """Its name in model files."""
        return str(self.term.model_fields["type"].default)

    @property
    def where(self) -> str:
        """The joint, or `all`."""
        return self.joint or WHOLE

    @property
    def label(self) -> str:
        """For messages."""
        return f"{self.effect.name} ({self.where})"

    def at(self, shape: Mapping[str, Any]) -> Term:
        """The term with these shape parameters."""
        joint = {} if self.joint is None else {"joint": self.joint}
        return self.term.model_validate({"type": self.type, **joint, **shape})

    def grid(self) -> Iterator[dict[str, Any]]:
        """The shapes that are tried."""
        if self.runs:
            yield from ({"runs": runs} for runs in self.runs)
            return
        shapes = self.shapes
        points = [shape.points for shape in shapes.values()]
        while np.prod(points) > LARGEST_GRID:
            points[int(np.argmax(points))] -= 1
        pairs = zip(shapes.values(), points, strict=True)
        axes = [shape.spread(n) for shape, n in pairs]
        for values in product(*axes):
            yield dict(zip(shapes, map(float, values), strict=True))


@dataclass(frozen=True)
class Option:
    """A family at one shape: its term, its columns (n, j, k) on the evidence, and their signs.

    `positive` (k,): where the parameter must not be negative.
    """

    family: Family
    shape: dict[str, Any]
    term: Term
    columns: np.ndarray
    positive: np.ndarray


def families(model: Model, bags: Sequence[tuple[int, ...]]) -> list[Family]:
    """Every candidate on every joint of the model, without those that the model has.

    `bags`: the numbers of the runs of each recording.
    """
    present = {(term.type, getattr(term, "joint", None)) for term in model.terms}
    out = []
    for cls in candidates(model.setting):
        joints = joints_of(cls, model.setting) or (None,)
        within = _parts(bags) if "runs" in cls.model_fields else ()
        if "runs" in cls.model_fields and not within:
            continue
        out += [Family(cls, joint, within) for joint in joints]
    return [family for family in out if (family.type, family.joint) not in present]


def _parts(bags: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Each recording by itself, and all from one on: what may have changed between them."""
    later = [tuple(run for bag in bags[first:] for run in bag) for first in range(1, len(bags) - 1)]
    return (*bags, *later) if len(bags) > 1 else ()


def option(evidence: Evidence, family: Family, shape: Mapping[str, Any]) -> Option:
    """`family` at `shape` on the evidence; `CraneError` where that cannot be observed."""
    term = family.at(shape)
    signs = [
        p.minimum == 0.0 and not family.changes for p in term.parameters(evidence.model.setting)
    ]
    return Option(family, dict(shape), term, evidence.columns(term), np.array(signs))


def options(
    evidence: Evidence, wanted: list[Family], progress: Progress = silent
) -> tuple[list[Option], dict[Family, str]]:
    """The options of all families, and why families are not observable in these recordings."""
    found: list[Option] = []
    absent: dict[Family, str] = {}
    for number, family in enumerate(wanted):
        try:
            found += [option(evidence, family, shape) for shape in family.grid()]
        except CraneError as error:
            found = [one for one in found if one.family != family]
            absent[family] = str(error)
        progress("candidates", (number + 1) / len(wanted))
    return found, absent
