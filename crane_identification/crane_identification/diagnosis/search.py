"""The search for missing effects in one body of evidence: what can be seen of each, by itself."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from crane_identification.diagnosis.candidates import (
    Candidate,
    ShapedCandidate,
    at_shape,
    observed,
)
from crane_identification.diagnosis.constants import DETECTABLE_SHARE, VISIBLE_SHARE
from crane_identification.diagnosis.evidence import Evidence, beside, leading
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
from crane_identification.thresholds import Thresholds
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

# Nonparametric curves of effects, and signatures of no effect. Curves do not enter the selection:
# more candidates would raise the gain of the best one by chance.


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
    """A dependence of a force on a joint in words, the `types` of the effects that have it (none:
    not in the catalogue), its term and the columns (n, c, k).
    """

    said: str
    types: tuple[str, ...]
    term: Term
    columns: np.ndarray


@dataclass(frozen=True)
class Shapes:
    """Curves and unlisted signatures over some evidence, each computed once."""

    evidence: Evidence | None = None
    drawn: dict[Candidate, ShapedCandidate | None] = field(default_factory=dict)
    strange: dict[str, tuple[ForceSignature, ...]] = field(default_factory=dict)

    def of(self, candidate: Candidate) -> ShapedCandidate | None:
        """The effect with its law drawn; None if nothing draws it."""
        if candidate not in self.drawn:
            evidence = self.evidence
            self.drawn[candidate] = None if evidence is None else _drawn(evidence, candidate)
        return self.drawn[candidate]

    def unlisted_signatures(self, joint: str) -> tuple[ForceSignature, ...]:
        """Signatures on a joint that no effect of the catalogue has."""
        if self.evidence is None:
            return ()
        if joint not in self.strange:
            found = []
            for term in unlisted_signatures(self.evidence.model.setting, joint):
                try:
                    columns = self.evidence.columns(term)
                except CraneError:  # what it follows was not logged
                    continue
                found.append(ForceSignature(term.unlisted_signature, (), term, columns))
            self.strange[joint] = tuple(found)
        return self.strange[joint]


def shape_of(candidate: Candidate) -> type[NonparametricTerm] | None:
    """The term that draws the law of an effect; None if none does, and of changes."""
    free = candidate.joint is not None and not candidate.changes
    return NONPARAMETRIC_TERMS.get(candidate.type) if free else None


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
    thresholds: Thresholds
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

    def beside(self, *columns: np.ndarray) -> np.ndarray:
        """Columns (n, c, k) as whitened rows (N, k) without what the base explains."""
        return beside(self.base.basis, self.whitener(np.concatenate(columns, axis=2)))

    # How much candidates explain, and how much they leave, in energy beyond noise.

    def channels(self, number: int) -> np.ndarray:
        """The channels in which a candidate acts: of its joint, and of those that carry it too."""
        return np.flatnonzero(self.projection.candidates[number].columns.any(axis=(0, 2)))

    def explained(self, *columns: np.ndarray) -> float:
        """2 dlogL that columns (n, c, k), whatever their signs, gain together beside the base."""
        if not columns:
            return 0.0
        white = self.whitener(np.concatenate(columns, axis=2))
        rest = beside(self.base.basis, white)
        seen = np.linalg.norm(rest, axis=0) > VISIBLE_SHARE * np.linalg.norm(white, axis=0)
        known = leading(rest[:, seen], int(seen.sum()))
        return float(((known.T @ self.base.residual) ** 2).sum())

    def gained(self, rest: Sequence[np.ndarray], columns: np.ndarray) -> float:
        """Gain in 2 log L by columns (n, c, k) beside the `rest` (n, c, k each)."""
        return self.explained(*rest, columns) - self.explained(*rest)

    def unexplained(self, subset: Subset) -> np.ndarray:
        """Energy (c,) beyond noise of variance one that a set leaves in each channel."""
        projection = self.projection
        inside = [column for i in subset.numbers for column in projection.columns_of[i]]
        left = projection.residual - projection.columns[:, inside] @ subset.values
        noise = 1.0 - (self.base.basis**2).sum(axis=1)
        return self._by_channel(left**2 - noise)

    def unexplained_on_joints(self, subset: Subset) -> np.ndarray:
        """Energy (j,) that a set leaves on each joint; less than noise counts as none."""
        by_channel = np.maximum(self.unexplained(subset), 0.0)
        return np.asarray(by_channel.reshape(-1, len(self.evidence.joints)).sum(axis=0))

    def unexplained_beside(self, subset: Subset, place: int) -> float:
        """Energy that a set leaves unexplained where one of its effects acts, at least 0."""
        left = self.unexplained(subset)[self.channels(subset.numbers[place])].sum()
        return max(float(left), 0.0)

    def left_share(self, wanted: Sequence[ShapedCandidate]) -> float:
        """Share of the energy beyond noise that these together leave where they act; 0 for none."""
        subset = self.together(wanted)
        own = sorted({int(c) for number in subset.numbers for c in self.channels(number)})
        before, after = (self.unexplained(one)[own].sum() for one in (NOTHING, subset))
        return float(after / before) if before > 0.0 else 0.0

    def normalized_energy(self, left: np.ndarray) -> np.ndarray:
        """Energy (c,) of a residual (n, c) in units of the noise."""
        variance = [1.0 if noise is None else noise.variance for noise in self.whitener.noise]
        return (np.where(self.evidence.used, left, 0.0) ** 2).sum(axis=0) / np.array(variance)

    def _by_channel(self, power: np.ndarray) -> np.ndarray:
        return np.bincount(self.whitener.channel, power, self.evidence.used.shape[1])

    # The same as a strength: root mean square over that of the force.

    def strength(self, number: int, score: float) -> float:
        """Root mean square of what a candidate of this score explains over that of the force."""
        projection = self.projection
        rows = (projection.columns[:, projection.columns_of[number]] ** 2).sum(axis=1)
        power = self._by_channel(rows)
        shares = power / max(float(power.sum()), np.finfo(float).tiny)
        return float(self.strengths(score * shares).max())

    def strengths(self, energy: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of so much energy (c,) over that of the force of the joint."""
        evidence, joints = self.evidence, len(self.evidence.joints)
        variance = np.array([0.0 if one is None else one.variance for one in self.whitener.noise])
        power = (np.maximum(energy, 0.0) * variance).reshape(-1, joints).sum(axis=0)
        rows = evidence.used.reshape(len(evidence.time), -1, joints).sum(axis=(0, 1))
        rms = np.sqrt(power / np.maximum(rows, 1))
        force = evidence.over_zones(evidence.force)
        return np.divide(rms, force, out=np.zeros_like(rms), where=force > 0.0)

    def is_strong(self, gain: float, j: int) -> bool:
        """Return whether so much `gain` on joint j is more than errors of the processing."""
        energy = np.zeros(len(self.whitener.noise))
        energy[j] = gain
        return bool(self.strengths(energy)[j] >= self.thresholds.gates.smallest_strength)

    def detectable(self, threshold: float) -> float:
        """Strength at which nearly all testable candidates reach the threshold, or infinite."""
        strengths: dict[Candidate, float] = {}
        candidates = self.projection.candidates
        for number, share in enumerate(self.projection.visibility):
            candidate = candidates[number].candidate
            least = self.strength(number, threshold) / max(float(share), 1e-9)
            strengths[candidate] = min(strengths.get(candidate, np.inf), least)
        least_of = list(strengths.values())
        return float(np.quantile(least_of, DETECTABLE_SHARE)) if least_of else np.inf

    def named_from(self, threshold: float) -> dict[str, float]:
        """By joint: the strength from which nearly all of the testable candidates are named, before
        it is filtered to rows, at the median of their shapes; infinite if none is testable.
        """
        strengths: dict[Candidate, list[float]] = {}
        for number, shaped in enumerate(self.projection.candidates):
            least = self._named_from(number, threshold)
            strengths.setdefault(shaped.candidate, []).append(least)
        out = {}
        for joint in self.evidence.joints:
            own = [np.median(each) for one, each in strengths.items() if one.joint in (joint, None)]
            nearly_all = np.quantile(own, DETECTABLE_SHARE, method="higher") if own else np.inf
            out[joint] = float(nearly_all)
        return out

    def _named_from(self, number: int, threshold: float) -> float:
        """Strength of a candidate from which its score, visible strength and value suffice."""
        projection, gate = self.projection, self.thresholds.gates.smallest_strength
        shaped, columns = projection.candidates[number], projection.columns_of[number]
        effect, scale = shaped.candidate.effect, projection.scale[columns]
        shows = self.strength(number, 1.0)  # with a score of one
        if shows <= 0.0 or not (scale > 0.0).all():
            return np.inf
        score = threshold if effect.formless else max(threshold, (gate / shows) ** 2)
        values = np.maximum(np.sqrt(score) / scale, effect.usual)
        acts = [
            self.evidence.acting(shaped.columns[:, :, [k]], values[[k]]) for k in range(len(values))
        ]
        return max(acts) / shaped.damped

    @property
    def testable_share(self) -> float:
        """Share of the observable effects that would show beside the model."""
        tested = {shaped.candidate for shaped in self.projection.candidates}
        return len(tested) / max(len(tested) + len(self.untestable), 1)

    # Beside further columns: a new search from the start.

    def beside_lengths(self) -> Self:
        """The same candidates beside a little more of each length, which no effect tells."""
        return self.widened(columns_of_lengths(self.evidence))

    def widened(self, columns: np.ndarray) -> Self:
        """The same candidates, from the start, beside the model and further columns (n, c, k)."""
        wider = np.concatenate([self.evidence.base, columns], axis=2)
        evidence = replace(self.evidence, base=wider)
        base = whitened_base(evidence, self.whitener)
        projection = project(self.whitener, base, self.projection.candidates)
        return replace(self, evidence=evidence, base=base, projection=projection)


def search(
    evidence: Evidence,
    wanted: list[Candidate],
    thresholds: Thresholds,
    progress: Progress = silent,
) -> Search:
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
    return Search(
        evidence, thresholds, white, base, kept, untestable, unobservable, seen, shapes=shapes
    )


# Lengths of links that are not those of the machine's file, as columns beside the model.

LENGTHS = ("a", "d")  # of a row of Table 1
LENGTH_STEP = 0.01  # relative, of the difference with respect to a length


def columns_of_lengths(evidence: Evidence) -> np.ndarray:
    """d(Phi Theta)/d(ln x) (n, c, k) by each length x of a link that makes a force."""
    model, machine = evidence.model, evidence.model.setting.machine
    force = evidence.base[:, :, : len(evidence.values)] @ evidence.values
    columns = []
    for longer in [] if machine is None else _each_longer(machine):
        other = replace(model, setting=model.setting._replace(machine=longer))
        columns.append((evidence.regressor(other) @ evidence.values - force) / LENGTH_STEP)
    moving = [one for one in columns if one.any()]
    return np.stack(moving, axis=2) if moving else evidence.base[:, :, :0]


def _each_longer(machine: Machine) -> list[Machine]:
    """The machine with each length of a link that it has, in turn, a little larger."""
    out = []
    for number, joint in enumerate(machine.joints):
        for name in LENGTHS if joint.dh else ():
            longer = machine.model_dump(by_alias=True)
            longer["joints"][number]["dh"][name] *= 1.0 + LENGTH_STEP
            out.append(Machine.model_validate(longer))
    return out
