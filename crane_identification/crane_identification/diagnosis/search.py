"""The search for missing effects in one body of evidence: what can be seen of each, by itself."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from crane_identification.diagnosis.candidates import (
    Candidate,
    ShapedCandidate,
    at_shape,
    observed,
)
from crane_identification.diagnosis.evidence import (
    VISIBLE_SHARE,
    Evidence,
    beside,
    leading,
    over_zones,
    relative,
)
from crane_identification.diagnosis.projection import (
    NOTHING,
    Base,
    Projection,
    Subset,
    Whitener,
    project,
    solve,
    whitened_base,
    whitener,
)
from crane_identification.diagnosis.visibility import (
    holds_noise,
    is_the_force_itself,
    left_out,
    of_own_noise,
    visible,
)
from crane_model.errors import CraneError
from crane_model.machine import Machine
from crane_model.progress_bar import Progress, silent
from crane_model.terms import (
    NONPARAMETRIC_TERMS,
    Effect,
    NonparametricTerm,
    Term,
    unlisted_signatures,
)

# Effects whose law is drawn, over what their joint went through, and signatures of no effect.
#
# Curves do not enter the selection: more candidates would raise what chance gives to the best of
# them. A curve is drawn for an effect that was found, beside the others.


@dataclass(frozen=True)
class Drawn(Candidate):
    """The effect of `term` with its law drawn `by` another term, at the knots that are `given`."""

    drawn = True

    by: type[NonparametricTerm] = field(kw_only=True)

    @property
    def effect(self) -> Effect:
        known = super().effect
        return known._replace(name=f"{known.name}, shape as drawn", signature=self.by.said)

    def at(self, shape: Mapping[str, Any]) -> Term:
        return self.by.model_validate({"joint": self.joint, **dict(self.given)})


class ForceSignature(NamedTuple):
    """What a force on a joint depends on, in words; the `types` of the effects that have this
    signature, none if the catalogue knows no such effect; its term and the columns (n, c, k).
    """

    said: str
    types: tuple[str, ...]
    term: Term
    columns: np.ndarray


@dataclass(frozen=True)
class Shapes:
    """What is drawn over some evidence, each once, when it is asked for."""

    evidence: Evidence | None = None
    drawn: dict[Candidate, ShapedCandidate | None] = field(default_factory=dict)
    strange: dict[str, tuple[ForceSignature, ...]] = field(default_factory=dict)

    def of(self, candidate: Candidate) -> ShapedCandidate | None:
        """The effect with its law drawn; None if nothing draws it."""
        if candidate not in self.drawn:
            self.drawn[candidate] = (
                None if self.evidence is None else _drawn(self.evidence, candidate)
            )
        return self.drawn[candidate]

    def unlisted_signatures(self, joint: str) -> tuple[ForceSignature, ...]:
        """Signatures on a joint that no effect of the catalogue has."""
        if self.evidence is None:
            return ()
        if joint not in self.strange:
            terms = unlisted_signatures(self.evidence.model.setting, joint)
            self.strange[joint] = tuple(
                one for term in terms if (one := _stranger(self.evidence, term)) is not None
            )
        return self.strange[joint]


def shape_of(candidate: Candidate) -> type[NonparametricTerm] | None:
    """The term that draws the law of an effect; None if none does, and of changes."""
    free = candidate.joint is not None and not candidate.changes
    return NONPARAMETRIC_TERMS.get(candidate.type) if free else None


def _stranger(evidence: Evidence, term: Term) -> ForceSignature | None:
    """The signature of a term; None if what it follows was not logged."""
    try:
        return ForceSignature(term.unlisted_signature, (), term, evidence.columns(term))
    except CraneError:
        return None


def _drawn(evidence: Evidence, candidate: Candidate) -> ShapedCandidate | None:
    cls = shape_of(candidate)
    if cls is None:
        return None
    j = evidence.joints.index(candidate.where)
    try:
        followed = [cls.followed(run.record, j)[run.kept] for run in evidence.runs]
        given = (("knots", cls.over(np.concatenate(followed)[evidence.used[:, j]])),)
        drawn = at_shape(evidence, Drawn(candidate.term, candidate.joint, given, by=cls), {})
    except (CraneError, ValueError):  # not logged, never but close to reversals, or unchanged
        return None
    over_force = cls.variable.startswith("force")
    own = over_force and is_the_force_itself(evidence, drawn.term, candidate.where)
    return None if own else drawn


@dataclass(frozen=True)
class Search:
    """Evidence, its whitening and base, and all candidates beside it; `sets` are the best of no
    effect, of one, and so on. `seen`: least share of the energy of friction that used rows see.
    """

    evidence: Evidence
    whitener: Whitener
    base: Base
    projection: Projection
    untestable: dict[Candidate, str]
    unobservable: dict[Candidate, str]
    seen: dict[Candidate, float] = field(default_factory=dict)
    sets: tuple[tuple[Subset, ...], ...] = ((NOTHING,),)
    shapes: Shapes = field(default_factory=Shapes)

    def number(self, shaped: ShapedCandidate) -> int:
        return next(i for i, one in enumerate(self.projection.candidates) if one is shaped)

    def together(self, wanted: Iterable[ShapedCandidate]) -> Subset:
        """The set of these candidates; `NOTHING` if they have no solution."""
        numbers = tuple(map(self.number, wanted))
        return (solve(self.projection, numbers) if numbers else None) or NOTHING


def search(evidence: Evidence, wanted: list[Candidate], progress: Progress = silent) -> Search:
    """The `wanted` candidates beside the model, at the shapes of their grids."""
    found, unobservable = observed(evidence, wanted, progress)
    largest = [one.columns for one in found if not holds_noise(one)]
    white = whitener(evidence, np.concatenate(largest, axis=2))
    base = whitened_base(evidence, white)
    projection = project(white, base, found)
    good, untestable = visible(projection, evidence, white)
    left = left_out(found)
    seen = {one: share for one, share in left.seen.items() if one not in untestable}
    untestable |= left.whole
    itself, noisy = of_own_noise(evidence, white, base, found)
    kept = projection.kept(good & ~left.hidden & ~itself)
    shapes = Shapes(evidence, dict.fromkeys(noisy))  # nor is anything drawn of these
    return Search(evidence, white, base, kept, untestable, unobservable, seen, shapes=shapes)


# How much candidates explain, and how much they leave, in energy beyond noise.

DETECTABLE_SHARE = 0.9
"""Share of the effects that would show at the strength that is called detectable."""


def channels(search: Search, number: int) -> np.ndarray:
    """The channels in which a candidate acts: of its joint, and of those that carry it too."""
    return np.flatnonzero(search.projection.candidates[number].columns.any(axis=(0, 2)))


def explained(search: Search, *columns: np.ndarray) -> float:
    """2 dlogL that columns (n, c, k), whatever their signs, gain together beside the base."""
    if not columns:
        return 0.0
    white = search.whitener(np.concatenate(columns, axis=2))
    rest = beside(search.base.basis, white)
    seen = np.linalg.norm(rest, axis=0) > VISIBLE_SHARE * np.linalg.norm(white, axis=0)
    known = leading(rest[:, seen], int(seen.sum()))
    return float(((known.T @ search.base.residual) ** 2).sum())


def gained(search: Search, rest: Sequence[np.ndarray], columns: np.ndarray) -> float:
    """Return the gain in 2 log L by columns (n, c, k) beside the `rest` (n, c, k each)."""
    return explained(search, *rest, columns) - explained(search, *rest)


def unexplained(search: Search, subset: Subset) -> np.ndarray:
    """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
    projection = search.projection
    inside = [column for i in subset.numbers for column in projection.columns_of[i]]
    left = projection.residual - projection.columns[:, inside] @ subset.values
    noise = 1.0 - (search.base.basis**2).sum(axis=1)
    return _by_channel(search, left**2 - noise)


def unexplained_on_joints(search: Search, subset: Subset) -> np.ndarray:
    """The same (j,) of each joint; what is less than noise counts as none."""
    by_channel = np.maximum(unexplained(search, subset), 0.0)
    return np.asarray(by_channel.reshape(-1, len(search.evidence.joints)).sum(axis=0))


def _by_channel(search: Search, power: np.ndarray) -> np.ndarray:
    return np.bincount(search.whitener.channel, power, search.evidence.used.shape[1])


def unexplained_beside(search: Search, subset: Subset, place: int) -> float:
    """What a set leaves unexplained where one of its effects acts, at least 0."""
    left = unexplained(search, subset)[channels(search, subset.numbers[place])].sum()
    return max(float(left), 0.0)


def left_share(search: Search, wanted: Sequence[ShapedCandidate]) -> float:
    """Share of the energy beyond noise that these together leave where they act; 0 for none."""
    subset = search.together(wanted)
    own = sorted({int(c) for number in subset.numbers for c in channels(search, number)})
    before, after = (unexplained(search, one)[own].sum() for one in (NOTHING, subset))
    return float(after / before) if before > 0.0 else 0.0


def energy_shares(search: Search, number: int) -> np.ndarray:
    """Share (c,) of what a candidate explains beside the base that each channel carries."""
    projection = search.projection
    power = (projection.columns[:, projection.columns_of[number]] ** 2).sum(axis=1)
    shares = _by_channel(search, power)
    return shares / max(float(shares.sum()), np.finfo(float).tiny)


def acting(evidence: Evidence, columns: np.ndarray, values: np.ndarray) -> float:
    """Root mean square of an effect, columns (n, c, k) with these values (k,), over that of the
    drive force of its joint.
    """
    return float(np.nan_to_num(relative(evidence, columns @ values)).max())


def strength(search: Search, number: int, score: float) -> float:
    """Root mean square of what a candidate of this score explains over that of the force."""
    return float(strengths(search, score * energy_shares(search, number)).max())


def strength_on(search: Search, gain: float, j: int) -> float:
    """Root mean square of what so much `gain` on joint j is, over that of its force."""
    energy = np.zeros(len(search.whitener.noise))
    energy[j] = gain
    return float(strengths(search, energy)[j])


def strengths(search: Search, energy: np.ndarray) -> np.ndarray:
    """Root mean square (j,) of what has so much energy (c,) over that of the force of the joint."""
    evidence, joints = search.evidence, len(search.evidence.joints)
    variance = np.array([0.0 if one is None else one.variance for one in search.whitener.noise])
    power = (np.maximum(energy, 0.0) * variance).reshape(-1, joints).sum(axis=0)
    rows = evidence.used.reshape(len(evidence.time), -1, joints).sum(axis=(0, 1))
    rms = np.sqrt(power / np.maximum(rows, 1))
    force = over_zones(evidence, evidence.force)
    return np.divide(rms, force, out=np.zeros_like(rms), where=force > 0.0)


def detectable(search: Search, threshold: float) -> float:
    """Strength at which nearly all of the testable candidates would reach the threshold; infinite
    if none is testable.
    """
    strengths: dict[Candidate, float] = {}
    candidates = search.projection.candidates
    for number, share in enumerate(search.projection.visibility):
        candidate = candidates[number].candidate
        least = strength(search, number, threshold) / max(float(share), 1e-9)
        strengths[candidate] = min(strengths.get(candidate, np.inf), least)
    return float(np.quantile(list(strengths.values()), DETECTABLE_SHARE)) if strengths else np.inf


def named_from(search: Search, threshold: float, gate: float) -> dict[str, float]:
    """By joint: the strength from which nearly all of the testable candidates are named, before it
    is filtered to rows; infinite if none is testable. Of the shapes of a candidate the median
    counts.
    """
    strengths: dict[Candidate, list[float]] = {}
    for number, shaped in enumerate(search.projection.candidates):
        least = _named_from(search, number, threshold, gate)
        strengths.setdefault(shaped.candidate, []).append(least)
    out = {}
    for joint in search.evidence.joints:
        own = [np.median(each) for one, each in strengths.items() if one.joint in (joint, None)]
        out[joint] = float(np.quantile(own, DETECTABLE_SHARE, method="higher")) if own else np.inf
    return out


def _named_from(search: Search, number: int, threshold: float, gate: float) -> float:
    """Strength of a candidate at its shape from which its score reaches the `threshold`, what shows
    of it the `gate`, and its value what is usual; infinite if a column does not show.
    """
    projection = search.projection
    shaped, columns = projection.candidates[number], projection.columns_of[number]
    effect, scale = shaped.candidate.effect, projection.scale[columns]
    shows = strength(search, number, 1.0)  # with a score of one
    if shows <= 0.0 or not (scale > 0.0).all():
        return np.inf
    score = threshold if effect.formless else max(threshold, (gate / shows) ** 2)
    values = np.maximum(np.sqrt(score) / scale, effect.usual)
    acts = [
        acting(search.evidence, shaped.columns[:, :, [k]], values[[k]]) for k in range(len(values))
    ]
    return max(acts) / shaped.damped


def normalized_energy(search: Search, left: np.ndarray) -> np.ndarray:
    """Energy (c,) of a residual (n, c) in units of the noise."""
    variance = [1.0 if noise is None else noise.variance for noise in search.whitener.noise]
    return (np.where(search.evidence.used, left, 0.0) ** 2).sum(axis=0) / np.array(variance)


def testable_share(search: Search) -> float:
    """Share of the observable effects that would show beside the model."""
    tested = {shaped.candidate for shaped in search.projection.candidates}
    return len(tested) / max(len(tested) + len(search.untestable), 1)


# Lengths of links that are not those of the machine's file, as columns beside the model.
#
# Where linkages are of another size than in their file, so may be the links. No effect says which:
# the force that a little more of each length makes is taken out of what is asked of the effects.

LENGTHS = ("a", "d")  # of a row of Table 1
STEP = 0.01  # relative


def beside_lengths(search: Search) -> Search:
    """The same candidates, from the start, beside the model and a little more of each length."""
    return widened(search, columns_of_lengths(search.evidence))


def widened(search: Search, columns: np.ndarray) -> Search:
    """The same candidates, from the start, beside the model and further columns (n, c, k)."""
    evidence = search.evidence
    evidence = replace(evidence, base=np.concatenate([evidence.base, columns], axis=2))
    base = whitened_base(evidence, search.whitener)
    projection = project(search.whitener, base, search.projection.candidates)
    return replace(search, evidence=evidence, base=base, projection=projection)


def columns_of_lengths(evidence: Evidence) -> np.ndarray:
    """d(Phi Theta)/d(ln x) (n, c, k) by each length x of a link that makes a force."""
    model, machine = evidence.model, evidence.model.setting.machine
    force = evidence.base[:, :, : len(evidence.values)] @ evidence.values
    columns = [
        (evidence.regressor(replace(model, setting=setting)) @ evidence.values - force) / STEP
        for longer in ([] if machine is None else _each_longer(machine))
        for setting in [model.setting._replace(machine=longer)]
    ]
    moving = [one for one in columns if one.any()]
    return np.stack(moving, axis=2) if moving else evidence.base[:, :, :0]


def _each_longer(machine: Machine) -> list[Machine]:
    """The machine with each length of a link that it has, in turn, larger by `STEP`."""
    out = []
    for number, joint in enumerate(machine.joints):
        for name in LENGTHS if joint.dh else ():
            longer = machine.model_dump(by_alias=True)
            longer["joints"][number]["dh"][name] *= 1.0 + STEP
            out.append(Machine.model_validate(longer))
    return out
