"""The effects that a model may lack: every candidate term, on every joint, at every shape."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.search.loads import LOADS, Loads, heavier
from crane_model.errors import CraneError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.terms import Effect, Setting, Shape, Term, candidates, joints_of

WHOLE = "all"  # in place of a joint
Given = tuple[tuple[str, tuple[float, ...]], ...]

ROUNDS = 6  # in which what a term takes from the model settles, at most,
SETTLED_SHARE = 1e-3  # to this share of it
LARGEST_GRID = 16  # shapes of a candidate; between them, the best is refined


@dataclass(frozen=True)
class Candidate:
    """An effect on one joint, or on the whole machine (`joint` is None), at any shape.

    `given`: fields that the model gives; `parts`: which recordings may differ from the others, for
    a term of `loads`.
    """

    term: type[Term]
    joint: str | None
    given: Given = ()
    parts: tuple[Loads, ...] = ()

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
    def drawn(self) -> bool:
        """Whether its law is a shape, as it was found, and no formula."""
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
        """How a message names it: effect and joint."""
        return f"{self.effect.name} ({self.where})"

    def at(self, shape: Mapping[str, Any]) -> Term:
        """The term with these shape parameters."""
        joint = {} if self.joint is None else {"joint": self.joint}
        return self.term.model_validate({"type": self.type, **joint, **dict(self.given), **shape})

    def grid(self) -> Iterator[dict[str, Any]]:
        """The shapes that are tried."""
        if self.parts:
            yield from ({LOADS: loads} for loads in self.parts)
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
class ShapedCandidate:
    """A candidate at one shape: its term, its columns (n, j, k) on the evidence, and their signs.

    `positive` (k,): where the parameter must not be negative; `seen`: share of the norm of the
    term, wherever it acts, that is in used samples; `damped`: ratio of rms to which the filter of
    the rows has damped it.
    """

    candidate: Candidate
    shape: dict[str, Any]
    term: Term
    columns: np.ndarray
    positive: np.ndarray
    seen: float = 1.0
    damped: float = 1.0

    def joints(self, names: Sequence[str]) -> list[int]:
        """Numbers of the joints (`names`) on which it acts: its own, or, of an effect of the whole
        machine, those where its columns are not zero.
        """
        if self.candidate.joint is not None:
            return [names.index(self.candidate.joint)]
        acting = self.columns.any(axis=(0, 2)).reshape(-1, len(names)).any(axis=0)
        return np.flatnonzero(acting).tolist()


def candidates_of(model: Model, evidence: Evidence) -> list[Candidate]:
    """Every candidate on every joint of the fitted model, without those that the model has."""
    present = {(kind, term.only_joint) for term in model.terms for kind in (term.type, *term.draws)}
    out = []
    for cls in candidates(model.setting):
        if cls.carries_loads and len(evidence.bags) < 2:
            continue
        parts = heavier(evidence, cls) if cls.carries_loads else ()
        out += [
            Candidate(cls, joint, _given(model, evidence, cls, joint), parts)
            for joint in joints_of(cls, model.setting) or (None,)
        ]
    return [candidate for candidate in out if (candidate.type, candidate.joint) not in present]


def _given(model: Model, evidence: Evidence, cls: type[Term], joint: str | None) -> Given:
    """The fields of a term that hold values of parameters of the model.

    These are what they are beside the term: without it, parameters make up for it.
    """
    known = [p.name for p in model.parameters]
    places = {
        field: [known.index(name) for name in names]
        for field, names in cls.of_model.items()
        if set(names) <= set(known)
    }
    given: Given = ()
    values = model.theta
    for _ in range(ROUNDS if places else 0):
        given = tuple((field, tuple(values[at].tolist())) for field, at in places.items())
        if evidence.keeps:
            break  # values that are kept do not make up for it
        before = values
        try:
            values = evidence.roughly(evidence.columns(Candidate(cls, joint, given).at({})))
        except CraneError:
            break  # not observable, which `observed` says
        if all(_settled(before[at], values[at]) for at in places.values()):
            break
    return given


def _settled(before: np.ndarray, after: np.ndarray) -> bool:
    return bool(np.linalg.norm(after - before) <= SETTLED_SHARE * np.linalg.norm(before))


def at_shape(evidence: Evidence, candidate: Candidate, shape: Mapping[str, Any]) -> ShapedCandidate:
    """`candidate` at `shape` on the evidence, as far as that shows it; `CraneError` where it cannot
    be observed.
    """
    term = candidate.at(shape)
    found = evidence.shown(term)
    shown = found.columns[evidence.used].any(axis=0)
    if not shown.all() and (part := term.showing(shown)) != term:
        term, found = part, evidence.shown(part)
    signs = [
        p.minimum == 0.0 and not candidate.changes for p in term.parameters(evidence.model.setting)
    ]
    return ShapedCandidate(
        candidate, dict(shape), term, found.columns, np.array(signs), found.seen, found.damped
    )


def observed(
    evidence: Evidence, wanted: list[Candidate], progress: Progress = silent
) -> tuple[list[ShapedCandidate], dict[Candidate, str]]:
    """The candidates at their shapes, and why some, or some of their parameters, are not observable
    in these recordings.
    """
    found: list[ShapedCandidate] = []
    absent: dict[Candidate, str] = {}
    for number, candidate in enumerate(wanted):
        try:
            own = [at_shape(evidence, candidate, shape) for shape in candidate.grid()]
            found += own
            if lost := _not_shown(own, evidence.model.setting):
                absent[candidate] = f"{', '.join(lost)}: no recording comes where it would show"
        except CraneError as error:
            found = [one for one in found if one.candidate != candidate]
            absent[candidate] = str(error)
        progress("candidates", (number + 1) / len(wanted))
    return found, absent


def _not_shown(shapes: Sequence[ShapedCandidate], setting: Setting) -> list[str]:
    """The parameters of a candidate that none of its shapes has here; none if none of it acts."""
    shapes = [one for one in shapes if one.columns.any()]
    whole = (one.candidate.at(one.shape) for one in shapes)
    names = [p.name for term in whole for p in term.parameters(setting)]
    shown = {p.name for one in shapes for p in one.term.parameters(setting)}
    return [name for name in dict.fromkeys(names) if name not in shown]
