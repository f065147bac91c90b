"""What candidates add to the base model: their columns with the base projected out.

By the theorem of Frisch, Waugh and Lovell, least squares on these gives the parameters and the
gain of the full model: no effect is absorbed in Theta, and Theta is not biased by one.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.whitening import FORCE_CORRELATION, Whitener, leading

TINY = np.finfo(float).tiny
ITSELF_TOLERANCE, ITSELF_CORRELATION = 0.05, 0.95
"""The measured force explains itself with the coefficient one: a column that is within this
tolerance of that and correlated with the residual by more than this is made of it, as |tau| sgn(v)
is where friction is all that the force overcomes."""
VISIBLE_SHARE = 0.02
"""Share of a column's norm that must be left beside the base for its effect to be testable. Asked
in the zone that shows it: friction with memory is Coulomb's but for the reversals.
"""
ROUNDING_SHARE = 1e-6  # share of a column's norm that is more than rounding
REPLICATES = 500
SEED = 20250101


@dataclass(frozen=True)
class Projection:
    """Candidates as columns (N, K) of norm one beside the base, and the residual (N,) of the base.

    `owner` (K,) is the number of the candidate of each column, `positive` (K,) its sign constraint,
    `scale` (K,) what one unit of the parameter weighs, `visibility` per candidate, that of its
    least visible column in the zone that most of its rest lies in.
    """

    candidates: tuple[ShapedCandidate, ...]
    columns: np.ndarray
    residual: np.ndarray
    owner: np.ndarray
    positive: np.ndarray
    scale: np.ndarray
    visibility: np.ndarray

    @cached_property
    def gram(self) -> np.ndarray:
        """Inner products of the columns (K, K)."""
        return self.columns.T @ self.columns

    @cached_property
    def score(self) -> np.ndarray:
        """Inner products of the columns with the residual (K,)."""
        return self.columns.T @ self.residual

    @cached_property
    def root(self) -> np.ndarray:
        """R (K, K) with R R^T the Gram matrix: from white noise to scores."""
        power, vectors = np.linalg.eigh(self.gram)
        return vectors * np.sqrt(np.maximum(power, 0.0))

    @cached_property
    def columns_of(self) -> tuple[np.ndarray, ...]:
        """The columns of each candidate."""
        return tuple(np.flatnonzero(self.owner == i) for i in range(len(self.candidates)))

    def kept(self, wanted: np.ndarray) -> Self:
        """The candidates marked in `wanted` (candidates,) alone."""
        numbers = np.flatnonzero(wanted)
        columns = np.isin(self.owner, numbers)
        return type(self)(
            tuple(self.candidates[i] for i in numbers),
            self.columns[:, columns],
            self.residual,
            np.searchsorted(numbers, self.owner[columns]),
            self.positive[columns],
            self.scale[columns],
            self.visibility[numbers],
        )

    def joined(self, other: Self) -> Self:
        """These candidates, then those of `other`."""
        grown = replace(
            self,
            candidates=self.candidates + other.candidates,
            columns=np.concatenate([self.columns, other.columns], axis=1),
            owner=np.concatenate([self.owner, other.owner + len(self.candidates)]),
            positive=np.concatenate([self.positive, other.positive]),
            scale=np.concatenate([self.scale, other.scale]),
            visibility=np.concatenate([self.visibility, other.visibility]),
        )
        # Inner products of the old columns are known.
        mixed = self.columns.T @ other.columns
        grown.__dict__["gram"] = np.block([[self.gram, mixed], [mixed.T, other.gram]])
        return grown


def project(
    evidence: Evidence,
    whitener: Whitener,
    candidates: list[ShapedCandidate],
    base: np.ndarray | None = None,
) -> Projection:
    """All candidates beside the base of the evidence, whitened.

    `base` (N, d) is what `whitened_base` gives, where it is known already.
    """
    base = whitened_base(evidence, whitener) if base is None else base
    force = whitener(evidence.left)
    residual = force - base @ (base.T @ force)
    zone = whitener.channel // len(evidence.joints)
    parts, visibility = [], np.zeros(len(candidates))
    scales = []
    for number, shaped in enumerate(candidates):
        columns = whitener(shaped.columns)
        rest = columns - base @ (base.T @ columns)
        norms, whole = np.linalg.norm(rest, axis=0), np.linalg.norm(columns, axis=0)
        visibility[number] = _visibility(columns, rest, zone).min(initial=1.0)
        scales.append(norms)
        parts.append(np.divide(rest, norms, out=np.zeros_like(rest), where=norms > 1e-12 * whole))
    owner = np.repeat(np.arange(len(candidates)), [len(s) for s in scales])
    return Projection(
        tuple(candidates),
        np.concatenate(parts, axis=1),
        residual,
        owner,
        np.concatenate([shaped.positive for shaped in candidates]),
        np.concatenate(scales),
        visibility,
    )


def _visibility(columns: np.ndarray, rest: np.ndarray, zone: np.ndarray) -> np.ndarray:
    """Share (k,) of the norm of columns (N, k) that is their rest, where most of the rest lies."""
    several = range(int(zone.max()) + 1)
    left, whole = (
        np.stack([np.linalg.norm(values[zone == z], axis=0) for z in several])
        for values in (rest, columns)
    )
    most = left.argmax(axis=0)[np.newaxis]
    left, whole = (np.take_along_axis(values, most, axis=0)[0] for values in (left, whole))
    return np.divide(left, whole, out=np.zeros_like(left), where=whole > 0.0)


def whitened_base(evidence: Evidence, whitener: Whitener) -> np.ndarray:
    """Basis B (N, d) of the whitened base, such that rows less B B^T of them are beside the base.

    Orthonormal; but where the values of the model are kept, not all of the columns u that they are
    uncertain by, with standard deviation a, is taken out. The rows have the covariance I + a^2 u
    u^T: they are white again after I - (1 - 1/sqrt(1 + a^2)) u u^T.
    """
    free = whitener(evidence.free)
    base = leading(free, free.shape[1])
    if not evidence.keeps:
        return base
    columns = whitener(evidence.uncertain)
    u, a, _ = np.linalg.svd(columns - base @ (base.T @ columns), full_matrices=False)
    return np.concatenate([base, u * np.sqrt(1.0 - 1.0 / np.hypot(1.0, a))], axis=1)


def testable(
    projection: Projection, evidence: Evidence, whitener: Whitener
) -> tuple[np.ndarray, dict[Candidate, str]]:
    """Which (candidates,) can be tested, and why others cannot."""
    candidates = [shaped.candidate for shaped in projection.candidates]
    least = np.array([_least(candidate) for candidate in candidates])
    visible = projection.visibility >= least
    itself = _force_itself(projection, evidence, whitener)
    wanted = visible & np.array([candidate not in itself for candidate in candidates], dtype=bool)
    reasons = {f: "its column is the measured force itself" for f in candidates if f in itself}
    best: dict[Candidate, float] = {}
    for candidate, share in zip(candidates, projection.visibility, strict=True):
        best[candidate] = max(best.get(candidate, 0.0), float(share))
    for candidate, share in best.items():
        if share < _least(candidate):
            reasons[candidate] = (
                "these recordings do not show all of its parameters"
                if candidate.changes
                else f"{share:.1%} of its column is left beside the model, "
                f"{VISIBLE_SHARE:.0%} needed"
            )
    return wanted, reasons


def _least(candidate: Candidate) -> float:
    """The least visibility needed: of a change, which has the form of the model's own term, any."""
    return ROUNDING_SHARE if candidate.changes else VISIBLE_SHARE


def _force_itself(projection: Projection, evidence: Evidence, whitener: Whitener) -> set[Candidate]:
    """Candidates of one joint with a column that is, beside the model there, the residual there.

    Asked on the rows of that joint alone: what the joints share in the base, and the residual of
    the others, would hide it.
    """
    joints = evidence.joints
    force, base = whitener(evidence.force), whitener(evidence.base)
    first = {shaped.candidate: shaped for shaped in reversed(projection.candidates)}
    found = set()
    for j, joint in enumerate(joints):
        rows = whitener.channel % len(joints) == j
        known = leading(base[rows], base.shape[1])
        rest = force[rows] - known @ (known.T @ force[rows])
        for candidate, shaped in first.items():
            if candidate.joint != joint:
                continue
            columns = whitener(shaped.columns)[rows]
            columns = columns - known @ (known.T @ columns)
            size, score = np.linalg.norm(columns, axis=0), rest @ columns
            alike = np.abs(score) / np.maximum(size * np.linalg.norm(rest), TINY)
            once = np.abs(score / np.maximum(size**2, TINY) - 1.0) < ITSELF_TOLERANCE
            if ((alike > FORCE_CORRELATION) | (once & (alike > ITSELF_CORRELATION))).any():
                found.add(candidate)
    return found


def null_gains(
    projection: Projection, inside: list[int], replicates: int = REPLICATES
) -> np.ndarray:
    """(replicates,) largest gain of any candidate beside the columns `inside`, from noise alone.

    Parametric bootstrap: the noise of whitened rows is white, so that the inner products with the
    columns are jointly normal with their Gram matrix as covariance, and need no rows at all.
    """
    rng = np.random.default_rng(SEED)
    score = projection.root @ rng.standard_normal((len(projection.gram), replicates))
    gram = projection.gram
    if inside:
        mixed = np.linalg.solve(gram[np.ix_(inside, inside)], gram[inside])
        score, gram = score - mixed.T @ score[inside], gram - gram[:, inside] @ mixed
    size = np.diag(gram)
    seen = size > 1e-6
    allowed = seen[:, None] & (~projection.positive[:, None] | (score > 0.0))
    gains = np.where(allowed, score**2 / np.where(seen, size, 1.0)[:, None], 0.0)
    # Candidates with several parameters gain the sum of their parts at most.
    totals = np.zeros((len(projection.candidates), replicates))
    np.add.at(totals, projection.owner, gains)
    return totals.max(axis=0)
