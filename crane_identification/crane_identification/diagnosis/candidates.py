"""The effects that a model may lack: every candidate term, on every joint, at every shape."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np

from crane_identification.diagnosis.constants import POWER_RATIO, SLIGHT_SHARE, SURE_SIGMAS
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.fit import Fitted
from crane_model.errors import CraneError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.terms import Effect, Setting, Shape, Term, candidates, joints_of, typical
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load

# What each recording carries: one mass a recording, and which of them agree.
#
# A mass in all recordings is a link's mass, which the model has. So masses are differences, and
# count from the lightest recording. Nothing here depends on the order of the recordings.
#
# What a held-out recording carries, no other can predict. It is estimated from the recording
# itself, with everything else as the training recordings gave it.

Loads = tuple[Load, ...]

LOADS = "loads"  # the field of a term that carries them
NO_LOAD = "none"  # what the lightest recordings carry: masses count from it

BLOCKS = 8  # of a recording, one left out at a time: what is left is not white


def load_of(evidence: Evidence, recordings: Sequence[int]) -> Load:
    """A load that these recordings of the evidence have in common."""
    names = evidence.sources
    return Load(
        runs=tuple(sorted(run for i in recordings for run in evidence.bags[i])),
        recordings=tuple(sorted(names[i] for i in recordings)),
    )


def one_each(evidence: Evidence) -> Loads:
    """A load of its own in each recording."""
    return tuple(load_of(evidence, [i]) for i in range(len(evidence.bags)))


def heavier(evidence: Evidence, cls: type[Term]) -> tuple[Loads, ...]:
    """A load in the heaviest recording, in the two heaviest, and so on up to all but one."""
    columns = evidence.columns(cls.model_validate({LOADS: one_each(evidence)}))
    masses = evidence.roughly(columns)[-columns.shape[2] :]
    order = np.argsort(-masses, kind="stable").tolist()
    return tuple((load_of(evidence, order[:count]),) for count in range(1, len(order)))


def agreeing(information: np.ndarray, score: np.ndarray, variance: float) -> list[list[int]]:
    """Recordings grouped by mass, lightest first, by information (b, b) and score (b,)."""
    masses = np.linalg.pinv(information, rcond=1e-9, hermitian=True) @ score
    groups = [[int(i)] for i in np.argsort(masses, kind="stable")]
    while True:
        means, gain = _of_groups(groups, information, score)
        joined = [
            [*groups[:k], groups[k] + groups[k + 1], *groups[k + 2 :]]
            for k in range(len(groups) - 1)
        ]
        lost = np.array([gain - _of_groups(one, information, score)[1] for one in joined])
        same = (lost < SURE_SIGMAS**2 * variance) | (np.diff(means) < SLIGHT_SHARE * np.ptp(means))
        if not same.any():
            return groups
        groups = joined[int(np.argmin(np.where(same, lost, np.inf)))]


def _of_groups(
    groups: Sequence[Sequence[int]], information: np.ndarray, score: np.ndarray
) -> tuple[np.ndarray, float]:
    """The mass (k,) of each group, and what they gain together."""
    member = np.zeros((len(score), len(groups)))
    for k, group in enumerate(groups):
        member[list(group), k] = 1.0
    means = np.linalg.pinv(member.T @ information @ member, rcond=1e-9, hermitian=True) @ (
        member.T @ score
    )
    return means, float(means @ member.T @ score)


@dataclass(frozen=True)
class Weighed:
    """The load [kg] of a held-out `recording`; `found` if those trained on carry the same."""

    recording: str
    mass: float
    std_dev: float
    found: bool


def with_own_loads(
    model: Model, training: Evidence, held_out: Evidence
) -> tuple[Model, tuple[Weighed, ...]]:
    """The model with what each held-out recording carries, and these loads."""
    usual = training.rms(training.residual(model))
    return weighed(model, held_out, held_out.residual(model), usual)


def weighed(
    model: Model, held_out: Evidence, left: np.ndarray, usual: np.ndarray
) -> tuple[Model, tuple[Weighed, ...]]:
    """The model with the load of each held-out recording, and these loads. `left` (n, c) is what
    the model leaves there, `usual` (c,) its rms in training. If those trained on carry the same, a
    load must make of a clearly larger residual a usual one.
    """
    term = _term_of_loads(model)
    if term is None:
        return model, ()
    known, loads = term.carried, one_each(held_out)
    columns = held_out.columns(term.model_copy(update={LOADS: loads}))
    weight = np.where(held_out.used, 1.0 / np.where(usual > 0.0, usual, np.inf), 0.0)
    found: dict[int, Weighed] = {}
    for k, source in enumerate(held_out.sources):
        inside = held_out.bag == k
        rows, used = weight[inside], held_out.used[inside]
        force, column = left[inside] * rows, columns[inside, :, k] * rows
        if not column.any():
            continue
        mass, spread = _fitted(column[used], force[used])
        power, rest = (
            float(((each**2).sum(axis=0) / np.maximum(used.sum(axis=0), 1)).max())
            for each in (force, force - mass * column)
        )
        sure = (
            abs(mass) > SURE_SIGMAS * spread and POWER_RATIO * rest < power and rest < POWER_RATIO
        )
        if known or sure:
            found[k] = Weighed(source, mass, spread, not known)
    if not found:
        return model, ()
    values = [one.mass for one in found.values()]
    grown = term.model_copy(update={LOADS: (*known, *(loads[k] for k in found))})
    if not known:
        theta, terms = np.append(model.theta, values), (*model.terms, grown)
    else:
        theta = np.insert(model.theta, model.part(term).stop, values)
        terms = tuple(grown if one == term else one for one in model.terms)
    return replace(model, terms=terms, values=theta, std_devs=None), tuple(found.values())


def _term_of_loads(model: Model) -> Term | None:
    """The term of the model whose loads may differ, or else a new one; None if it can hold none."""
    own = [term for term in model.terms if term.carries_loads]
    if own:  # without loads it is one mass in every run: the model says that none differs
        return next((term for term in own if term.of_recordings), None)
    held = candidates(model.setting)
    return next((typical(cls) for cls in held if cls.carries_loads), None)


def _fitted(column: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Coefficient of the column (n,) in the force, and its standard deviation by the jackknife."""
    block = np.arange(len(force)) * BLOCKS // max(len(force), 1)
    product, power = (np.bincount(block, each * column, BLOCKS) for each in (force, column))
    mass = product.sum() / power.sum()
    without = (product.sum() - product) / (power.sum() - power)
    return float(mass), float(np.sqrt((BLOCKS - 1) / BLOCKS * ((without - mass) ** 2).sum()))


WHOLE = "all"  # in place of a joint
Given = tuple[tuple[str, tuple[float, ...]], ...]

ROUNDS = 6  # in which what a term takes from the model settles, at most,
SETTLED_SHARE = 1e-3  # to this share of it
LARGEST_GRID = 16  # shapes of a candidate; between them, the best is refined


@dataclass(frozen=True)
class Candidate:
    """An effect on one joint, or on the whole machine (`joint` is None), at any shape. `given`:
    fields that the model gives; `parts`: loads that recordings may differ by. It `changes` a term
    that the model has, or its model form is `drawn`.
    """

    changes: ClassVar[bool] = False
    drawn: ClassVar[bool] = False

    term: type[Term]
    joint: str | None
    given: Given = ()
    parts: tuple[Loads, ...] = ()

    @property
    def effect(self) -> Effect:
        assert self.term.effect is not None  # candidates have one
        return self.term.effect

    @property
    def shapes(self) -> Mapping[str, Shape]:
        """The shape parameters that are sought."""
        return {} if self.changes or self.drawn else self.term.shapes

    @property
    def type(self) -> str:
        return str(self.term.model_fields["type"].default)

    @property
    def where(self) -> str:
        return self.joint or WHOLE

    @property
    def label(self) -> str:
        return f"{self.effect.name} ({self.where})"

    def at(self, shape: Mapping[str, Any]) -> Term:
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
    """A candidate at one shape: its term, its columns (n, j, k), and where (k,) its parameters must
    not be negative. `seen`: share of the norm that is in used samples; `damped`: ratio of rms to
    which the filter of the rows has damped it.
    """

    candidate: Candidate
    shape: dict[str, Any]
    term: Term
    columns: np.ndarray
    positive: np.ndarray
    seen: float = 1.0
    damped: float = 1.0

    def joints(self, names: Sequence[str]) -> list[int]:
        """Numbers of the joints (`names`) on which it acts."""
        if self.candidate.joint is not None:
            return [names.index(self.candidate.joint)]
        acting = self.columns.any(axis=(0, 2)).reshape(-1, len(names)).any(axis=0)
        return np.flatnonzero(acting).tolist()


def candidates_of(model: Model, evidence: Evidence) -> list[Candidate]:
    """Every candidate on every joint of the fitted model that it does not have."""
    present = {(kind, term.only_joint) for term in model.terms for kind in (term.type, *term.draws)}
    out = []
    for cls in candidates(model.setting):
        if cls.carries_loads and len(evidence.bags) < 2:
            continue
        parts = heavier(evidence, cls) if cls.carries_loads else ()
        out += [
            Candidate(cls, joint, parts=parts) for joint in joints_of(cls, model.setting) or (None,)
        ]
    absent = [each for each in out if (each.type, each.joint) not in present]
    return [
        replace(candidate, given=_given(model, evidence, candidate.term, candidate.joint))
        for candidate in absent
    ]


def _given(model: Model, evidence: Evidence, cls: type[Term], joint: str | None) -> Given:
    """The fields of a term that hold values of the model, with those values."""
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
        changes = ((values[at] - before[at], SETTLED_SHARE * before[at]) for at in places.values())
        if all(np.linalg.norm(change) <= np.linalg.norm(least) for change, least in changes):
            break
    return given


def at_shape(evidence: Evidence, candidate: Candidate, shape: Mapping[str, Any]) -> ShapedCandidate:
    """`candidate` at `shape` on the evidence, as far as that shows it."""
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
    """The candidates at their shapes, and why some do not show in these recordings."""
    found: list[ShapedCandidate] = []
    absent = {}
    for number, candidate in enumerate(wanted):
        progress("candidates", (number + 1) / len(wanted))
        try:
            own = [at_shape(evidence, candidate, shape) for shape in candidate.grid()]
            lost = _not_shown(own, evidence.model.setting)
        except CraneError as error:
            absent[candidate] = str(error)
            continue
        found += own
        if lost:
            absent[candidate] = f"{', '.join(lost)}: no recording comes where it would show"
    return found, absent


def _not_shown(shapes: Sequence[ShapedCandidate], setting: Setting) -> list[str]:
    """The parameters of a candidate that none of its shapes has here; none if none of it acts."""
    shapes = [one for one in shapes if one.columns.any()]
    whole = (one.candidate.at(one.shape) for one in shapes)
    names = [p.name for term in whole for p in term.parameters(setting)]
    shown = {p.name for one in shapes for p in one.term.parameters(setting)}
    return [name for name in dict.fromkeys(names) if name not in shown]


# What is asked of the recordings: effects that a model lacks, and where its values are kept, also
# changes of the terms that it has.


@dataclass(frozen=True)
class Change(Candidate):
    """A change of the parameters of a term that the model has, at the shape that it has."""

    changes = True

    own: Term = field(kw_only=True)

    @property
    def effect(self) -> Effect:
        known = self.term.effect or Effect(
            name=self.type.replace("_", " "),
            signature="the pattern of this term of the model",
            confusable=(),
            discriminated_by="the same motion on the machine as it was",
        )
        return known._replace(name=f"changed {known.name}")

    def at(self, shape: Mapping[str, Any]) -> Term:
        return self.own


def changes_of(model: Model) -> list[Candidate]:
    """A change of each term of the model, and a load in all recordings."""
    changed: list[Candidate] = [
        Change(type(term), term.only_joint, own=term) for term in model.terms
    ]
    held = {type(term) for term in model.terms}
    load = Payload in candidates(model.setting) and Payload not in held
    return [*changed, Candidate(Payload, None)] if load else changed


def wanted(fit: Fitted, without: Collection[str]) -> list[Candidate]:
    """The candidates that are asked for: not `without`, and none that the model had."""
    had = {(term.type, term.only_joint) for term in fit.left_out}
    changed = changes_of(fit.evidence.model) if fit.fixed else []
    return [
        candidate
        for candidate in (*candidates_of(fit.before, fit.evidence), *changed)
        if candidate.type not in without and (candidate.type, candidate.joint) not in had
    ]
