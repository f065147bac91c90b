"""Candidates beside the base model, and the sets of them that explain the residual best."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.constants import FORCE_CORRELATION
from crane_identification.diagnosis.evidence import (
    ROUNDING_SHARE,
    Evidence,
    beside,
    leading,
    says_nothing,
)
from crane_identification.estimation.autoregression import (
    Autoregression,
    predictors_of,
    restricted_likelihood,
)

# Rows whose noise is independent and of variance one, by an autoregression per channel.

DIRECTIONS = 60  # of the candidates that the largest model takes, the commonest ones
ROWS_PER_DIRECTION = 12  # a channel with fewer rows does not carry another direction


class _Pick(NamedTuple):
    """Rows of one channel with the same number of used rows directly before them."""

    channel: int
    rows: np.ndarray
    polynomial: np.ndarray
    deviation: float


@dataclass(frozen=True)
class Whitener:
    """Turns rows (n, c, ...) of the evidence into N independent rows of variance one. `row`,
    `channel` and `zone` (N,) say where each comes from.
    """

    noise: tuple[Autoregression | None, ...]
    picks: tuple[_Pick, ...]
    row: np.ndarray
    channel: np.ndarray
    zone: np.ndarray

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Whitened values (n, c, ...) as (N, ...)."""
        there = [values[:, channel].any() for channel in range(values.shape[1])]
        parts = []
        for channel, rows, polynomial, deviation in self.picks:
            if not there[channel]:
                parts.append(np.zeros((len(rows), *values.shape[2:])))
                continue
            column = values[:, channel]
            part = sum(a * column[rows - lag] for lag, a in enumerate(polynomial))
            parts.append(part / deviation)
        return np.concatenate(parts)


def whitener(evidence: Evidence, largest: np.ndarray) -> Whitener:
    """From the residual of the `largest` model: its columns (n, c, K) beside the base. Beside a
    smaller model, noise would hold the effects that are sought.
    """
    noise: list[Autoregression | None] = []
    picks: list[_Pick] = []
    first = np.diff(evidence.run, prepend=-1) != 0
    for c, used in enumerate(evidence.used.T):
        known = leading(evidence.base[used, c], evidence.base.shape[2])
        if says_nothing(used, known):
            noise.append(None)
            continue
        found = _noise(known, largest[:, c], evidence.force[:, c], used, evidence.run)
        noise.append(found)
        before = _used_before(used, first, len(found.polynomial) - 1)
        predictors = predictors_of(found.autocovariance(len(found.polynomial)))
        for m, (polynomial, variance) in enumerate(zip(*predictors, strict=True)):
            rows = np.flatnonzero(used & (before == m))
            if len(rows):
                picks.append(_Pick(c, rows, polynomial, float(np.sqrt(variance))))
    none = np.zeros(0, dtype=int)
    row = np.concatenate([none, *(pick.rows for pick in picks)])
    channel = np.concatenate([none, *(np.full(len(pick.rows), pick.channel) for pick in picks)])
    zone = channel // len(evidence.model.joints)
    return Whitener(tuple(noise), tuple(picks), row, channel, zone)


def _noise(
    known: np.ndarray, columns: np.ndarray, force: np.ndarray, used: np.ndarray, run: np.ndarray
) -> Autoregression:
    """Beside the orthonormal directions `known` of the base, and those of the columns."""
    columns = columns[:, columns.any(axis=0)]
    rest, residual = beside(known, columns[used]), beside(known, force[used])
    norms = np.linalg.norm(rest, axis=0)
    telling = norms > ROUNDING_SHARE * np.linalg.norm(columns[used], axis=0)
    telling[telling] &= np.abs(residual @ rest[:, telling]) < (
        FORCE_CORRELATION * norms[telling] * np.linalg.norm(residual)
    )
    count = min(DIRECTIONS, (int(used.sum()) - known.shape[1]) // ROWS_PER_DIRECTION)
    more = leading(rest[:, telling], count) if count > 0 else rest[:, :0]
    basis = np.zeros((len(used), known.shape[1] + more.shape[1]))
    basis[used] = np.linalg.qr(np.concatenate([known, more], axis=1))[0]
    found = restricted_likelihood(*(_by_run(v, run) for v in (basis, force, used)))
    assert found is not None  # `whitener` asks for more rows than directions
    floor = (1e-9 * np.sqrt((force[used] ** 2).mean())) ** 2  # of a machine without any noise
    return Autoregression(found.polynomial, max(found.variance, floor, np.finfo(float).tiny))


def _used_before(used: np.ndarray, first: np.ndarray, highest: int) -> np.ndarray:
    """Used rows (n,) directly before each, of the same run, up to `highest`."""
    row = np.arange(len(used))
    none = first | ~np.concatenate([[False], used[:-1]])
    return np.minimum(row - np.maximum.accumulate(np.where(none, row, 0)), highest)


def _by_run(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Values (n, ...) as (runs, longest run, ...), padded with zeros."""
    numbers, counts = np.unique(run, return_counts=True)
    out = np.zeros((len(numbers), counts.max(), *values.shape[1:]), dtype=values.dtype)
    for i, number in enumerate(numbers):
        out[i, : counts[i]] = values[run == number]
    return out


class Base(NamedTuple):
    """Basis B (N, d), of which rows less B B^T are beside the base, and the `residual` (N,)."""

    basis: np.ndarray
    residual: np.ndarray


def whitened_base(evidence: Evidence, whitener: Whitener) -> Base:
    """The base of the evidence, whitened.

    Its basis is orthonormal; but where the values of the model are kept, not all of the columns u
    that they are uncertain by, with standard deviation a, is taken out. The rows have the
    covariance I + a^2 u u^T: they are white again after I - (1 - 1/sqrt(1 + a^2)) u u^T.
    """
    free, force = (whitener(values) for values in (evidence.free, evidence.left))
    basis = leading(free, free.shape[1])
    if evidence.keeps:
        columns = beside(basis, whitener(evidence.uncertain))
        u, a, _ = np.linalg.svd(columns, full_matrices=False)
        basis = np.concatenate([basis, u * np.sqrt(1.0 - 1.0 / np.hypot(1.0, a))], axis=1)
    return Base(basis, beside(basis, force))


# What candidates add to the base model: their columns with the base projected out.
#
# By the theorem of Frisch, Waugh and Lovell, least squares on these gives the parameters and the
# gain of the full model: no effect is absorbed in Theta, and Theta is not biased by one.


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
    def largest(self) -> np.ndarray:
        """Limits of the coefficients (K,)."""
        limits = np.array([one.candidate.effect.largest for one in self.candidates])
        return limits[self.owner] * self.scale

    @cached_property
    def gram(self) -> np.ndarray:
        return self.columns.T @ self.columns

    @cached_property
    def score(self) -> np.ndarray:
        return self.columns.T @ self.residual

    @cached_property
    def root(self) -> np.ndarray:
        """R (K, K) with R R^T the Gram matrix."""
        power, vectors = np.linalg.eigh(self.gram)
        return vectors * np.sqrt(np.maximum(power, 0.0))

    @cached_property
    def columns_of(self) -> tuple[np.ndarray, ...]:
        return tuple(np.flatnonzero(self.owner == i) for i in range(len(self.candidates)))

    @cached_property
    def effect(self) -> np.ndarray:
        """Number (candidates,) of the effect of each candidate."""
        known: dict[Candidate, int] = {}
        numbers = (known.setdefault(one.candidate, len(known)) for one in self.candidates)
        return np.array(list(numbers), dtype=int)

    def best_shapes(self, gains: np.ndarray) -> list[int]:
        """Return the candidate with the largest of the `gains` (candidates,) for each effect."""
        order = np.lexsort((-gains, self.effect))
        first = np.unique(self.effect[order], return_index=True)[1]
        return order[first].tolist()

    @cached_property
    def by_count(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """The numbers (m,) and the columns (m, k) of the candidates that have k of them."""
        counts = np.array([len(columns) for columns in self.columns_of], dtype=int)
        groups = ((k, np.flatnonzero(counts == k)) for k in np.unique(counts[counts > 0]).tolist())
        return {
            k: (numbers, np.stack([self.columns_of[i] for i in numbers])) for k, numbers in groups
        }

    def kept(self, wanted: np.ndarray) -> Self:
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


def project(whitener: Whitener, base: Base, candidates: Sequence[ShapedCandidate]) -> Projection:
    """The candidates beside the base, whitened."""
    parts, visibility = [], np.zeros(len(candidates))
    scales = []
    for number, shaped in enumerate(candidates):
        columns = whitener(shaped.columns)
        rest = beside(base.basis, columns)
        norms, whole = np.linalg.norm(rest, axis=0), np.linalg.norm(columns, axis=0)
        visibility[number] = _visibility(columns, rest, whitener.zone).min(initial=1.0)
        scales.append(norms)
        parts.append(np.divide(rest, norms, out=np.zeros_like(rest), where=norms > 1e-12 * whole))
    owner = np.repeat(np.arange(len(candidates)), [len(s) for s in scales])
    return Projection(
        tuple(candidates),
        np.concatenate(parts, axis=1),
        base.residual,
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


# Which effects together explain the residual best: a beam search over sets of candidates.

BEAM = 24  # sets that are followed from each size to the next
SINGULAR_SHARE = 1e-6
"""Share of a column's norm left beside the chosen ones, below which it is one of them."""


class Subset(NamedTuple):
    """A set of candidates (numbers of the projection), its gain 2 dlogL, and the coefficients."""

    numbers: tuple[int, ...]
    gain: float
    values: np.ndarray  # of the columns of the candidates, one after another


NOTHING = Subset((), 0.0, np.zeros(0))


LargerSets = dict[frozenset[int], Subset]
"""The best set of shapes for each set of effects, by the numbers of these."""


def larger_sets(
    projection: Projection,
    beam: Sequence[Subset],
    refused: Collection[Candidate] = (),
    first: int = 0,
) -> LargerSets:
    """The sets with one candidate more, from number `first` on, that is not `refused`."""
    found: LargerSets = {}
    for start in beam:
        for subset in extended(projection, start, refused, first):
            key = frozenset(projection.effect[list(subset.numbers)].tolist())
            if key not in found or subset.gain > found[key].gain:
                found[key] = subset
    return found


def extended(
    projection: Projection, start: Subset, refused: Collection[Candidate] = (), first: int = 0
) -> Iterator[Subset]:
    """`start` with each further candidate, at its best shape, where signs and sizes are right."""
    inside = np.array([c for i in start.numbers for c in projection.columns_of[i]], dtype=int)
    beside = BesideSet(projection, inside)
    gains = np.full(len(projection.candidates), -np.inf)
    for numbers, columns in projection.by_count.values():
        numbers, columns = numbers[numbers >= first], columns[numbers >= first]
        score = beside.score[columns]
        values, apart = constrained(beside.blocks(columns), score, projection.positive[columns])
        seen = apart & values.any(axis=1)
        gains[numbers[seen]] = np.einsum("mk,mk->m", values, score)[seen]
    known = {*refused} | {projection.candidates[i].candidate for i in start.numbers}
    further = [
        number
        for number in projection.best_shapes(gains)
        if gains[number] > 0.0 and projection.candidates[number].candidate not in known
    ]
    whatever_signs: dict[int, np.ndarray] = {}
    for numbers, columns in projection.by_count.values():
        chosen = np.isin(numbers, further)
        own = columns[chosen]
        every = np.concatenate([np.broadcast_to(inside, (len(own), len(inside))), own], axis=1)
        blocks = projection.gram[every[:, :, np.newaxis], every[:, np.newaxis]]
        values = np.linalg.solve(blocks, projection.score[every][..., np.newaxis])[..., 0]
        right = ~(projection.positive[every] & (values < 0.0)).any(axis=1)
        whatever_signs.update(zip(numbers[chosen][right].tolist(), values[right], strict=True))
    for number in further:
        numbers_of_set = (*start.numbers, number)
        solved = (
            _subset(projection, numbers_of_set, whatever_signs[number])
            if number in whatever_signs
            else solve(projection, numbers_of_set)
        )
        if solved is not None:
            yield solved


class BesideSet:
    """Scores (K,) and Gram matrices beside the columns `inside` (d,): Schur complements."""

    def __init__(self, projection: Projection, inside: np.ndarray) -> None:
        self._gram, self._inside = projection.gram, inside
        block = projection.gram[np.ix_(inside, inside)]
        self.mixed = np.linalg.solve(block, projection.gram[inside])
        self.score = self.of(projection.score)

    def of(self, score: np.ndarray) -> np.ndarray:
        """The `score` (K, ...) of a force after the projection of the columns."""
        return np.asarray(score - self.mixed.T @ score[self._inside])

    def blocks(self, columns: np.ndarray) -> np.ndarray:
        """Gram matrices (m, k, k) of m candidates of so many columns (m, k)."""
        own = self._gram[columns[:, :, np.newaxis], columns[:, np.newaxis]]
        across = self._gram[self._inside[:, np.newaxis, np.newaxis], columns]
        return np.asarray(own - np.einsum("dmk,dml->mkl", across, self.mixed[:, columns]))


def constrained(
    gram: np.ndarray, score: np.ndarray, positive: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solutions (m, k) of m systems gram (m, k, k) values = score (m, k) with the `positive` values
    that would be negative at zero, and which (m,) have one.
    """
    free, apart = np.ones(score.shape, dtype=bool), np.ones(len(score), dtype=bool)
    values, asked = np.zeros(score.shape), np.arange(len(score))
    while len(asked):
        held = ~free[asked]
        part = np.where(held[:, :, np.newaxis] | held[:, np.newaxis], 0.0, gram[asked])
        part[:, range(score.shape[1]), range(score.shape[1])] += held
        apart[asked] = np.linalg.eigvalsh(part)[:, 0] >= SINGULAR_SHARE**2
        part, held, asked = part[apart[asked]], held[apart[asked]], asked[apart[asked]]
        wanted = np.where(held, 0.0, score[asked])
        values[asked] = np.linalg.solve(part, wanted[..., np.newaxis])[..., 0]
        wrong = positive[asked] & (values[asked] < 0.0)
        free[asked] &= ~wrong
        asked = asked[wrong.any(axis=1)]
    return np.where(free, values, 0.0), apart


def solve(projection: Projection, numbers: tuple[int, ...]) -> Subset | None:
    """Joint solution of candidates; None if a sign or size is wrong, or columns coincide."""
    columns = np.concatenate([projection.columns_of[i] for i in numbers])
    gram, score = projection.gram[np.ix_(columns, columns)], projection.score[columns]
    (values,), (apart,) = constrained(gram[None], score[None], projection.positive[None, columns])
    return _subset(projection, numbers, values) if apart else None


def _subset(projection: Projection, numbers: tuple[int, ...], values: np.ndarray) -> Subset | None:
    columns = np.concatenate([projection.columns_of[i] for i in numbers])
    begins = np.cumsum([0, *(len(projection.columns_of[i]) for i in numbers[:-1])])
    possible = (np.abs(values) <= projection.largest[columns]).all()
    if not possible or not np.logical_or.reduceat(values != 0.0, begins).all():
        return None
    return Subset(numbers, float(values @ projection.score[columns]), values)
