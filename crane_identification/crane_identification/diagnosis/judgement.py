"""An effect weighed against chance, held-out recordings and others in its place."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.constants import (
    FEWEST_ACTING,
    FEWEST_OCCASIONS,
    FEWEST_RECORDINGS,
    HELD_SHARE,
    IDENTICAL_CORRELATION,
    LITTLE_SHARE,
    QUIET_SHARE,
    TIME_BLOCKS,
)
from crane_identification.diagnosis.evidence import TINY, Evidence, beside, leading
from crane_identification.diagnosis.projection import (
    NOTHING,
    SINGULAR_SHARE,
    BesideSet,
    Projection,
    Subset,
    Whitener,
    constrained,
    extended,
    solve,
)
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import others
from crane_identification.thresholds import Thresholds

# What chance alone explains, and the score that an effect therefore needs.

REPLICATES = 500
SEED = 20250101


def null_gains(
    projection: Projection, numbers: Sequence[int], replicates: int = REPLICATES
) -> np.ndarray:
    """(replicates,) largest gain of any candidate beside those with these numbers, from noise.

    Parametric bootstrap: scores of white noise are jointly normal with the Gram matrix as
    covariance.
    """
    inside = np.array([c for i in numbers for c in projection.columns_of[i]], dtype=int)
    beside_set = BesideSet(projection, inside)
    rng = np.random.default_rng(SEED)
    score = projection.root @ rng.standard_normal((len(projection.gram), replicates))
    score = beside_set.of(score)
    size = beside_set.blocks(np.arange(len(score))[:, np.newaxis])[:, 0, 0]
    seen = size > 1e-6
    allowed = seen[:, None] & (~projection.positive[:, None] | (score > 0.0))
    gains = np.where(allowed, score**2 / np.where(seen, size, 1.0)[:, None], 0.0)
    # Of several parameters, what all gain together; of those with signs at most, and at most the
    # sum of their parts, since alike columns only take from each other.
    totals = np.zeros((len(projection.candidates), replicates))
    np.add.at(totals, projection.owner, gains)
    for count, (several, columns) in projection.by_count.items():
        if count > 1:
            blocks = beside_set.blocks(columns)
            inverse = np.linalg.pinv(blocks, rcond=1e-9, hermitian=True)
            own = score[columns]
            free = np.einsum("mkr,mkr->mr", own, inverse @ own)
            signed = projection.positive[columns].all(axis=1)[:, np.newaxis]
            totals[several] = np.where(signed, np.minimum(totals[several], free), free)
    return totals.max(axis=0)


def by_chance(search: Search, before: Subset) -> float:
    """The gain asked of an effect beside a set: more than chance adds to the set."""
    null, thresholds = null_gains(search.projection, before.numbers), search.thresholds
    level = 1.0 - thresholds.method.false_alarm_rate / 2.0
    return thresholds.gates.score_factor * float(np.quantile(null, level))


def chance_of(search: Search, columns: np.ndarray) -> float:
    """Gain asked of so many columns (n, c, k): more than chance gives them."""
    level = 1.0 - search.thresholds.method.false_alarm_rate / 2.0
    return search.thresholds.gates.score_factor * float(chi2.ppf(level, columns.shape[2]))


# Whether an effect improves the prediction of recordings that it was not fitted to. Only recordings
# in which it acts count: elsewhere, chance alone decides.


class Folds(NamedTuple):
    """The fold (n,) of each row, -1 where it is in none, and the names of the folds."""

    fold: np.ndarray
    names: tuple[str, ...]


def folds(evidence: Evidence) -> Folds:
    """Recordings, or blocks of time."""
    if len(evidence.sources) >= FEWEST_RECORDINGS:
        return Folds(evidence.bag, evidence.sources)
    order = np.arange(len(evidence.time))
    return _blocks(order * TIME_BLOCKS // len(order), TIME_BLOCKS)


def folds_of(evidence: Evidence, whitener: Whitener, force: np.ndarray) -> Folds:
    """Folds in which a `force` (n, c) acts: recordings, or blocks of time of like energy."""
    every = folds(evidence)
    if len(evidence.sources) < FEWEST_RECORDINGS:
        return every
    power = np.bincount(whitener.row, whitener(force) ** 2, len(force))
    share = np.bincount(evidence.bag, power, len(every.names)) / max(power.sum(), TINY)
    acting = share * len(every.names) > LITTLE_SHARE
    if acting.sum() >= FEWEST_ACTING:
        number = np.where(acting, np.cumsum(acting) - 1, -1)
        names = (name for name, there in zip(every.names, acting, strict=True) if there)
        return Folds(number[evidence.bag], tuple(names))
    there = acting[evidence.bag] & (power > QUIET_SHARE * power.max())
    begins = there & ~np.concatenate([[False], there[:-1] & (np.diff(evidence.run) == 0)])
    if begins.sum() < FEWEST_OCCASIONS:
        return every
    energy = power[there]
    share = (np.cumsum(energy) - energy / 2.0) / energy.sum()
    used, number = np.unique((share * TIME_BLOCKS).astype(int), return_inverse=True)
    block = np.full(len(power), -1)
    block[there] = number
    return _blocks(block, len(used)) if len(used) >= FEWEST_ACTING else every


def _blocks(block: np.ndarray, count: int) -> Folds:
    return Folds(block, tuple(f"block {i + 1} of {count}" for i in range(count)))


def held_out_gains(
    search: Search, rest: Sequence[np.ndarray], added: np.ndarray, asked: Folds | None = None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Gains in 2 log L on held-out folds by `added` (n, c, k) to the `rest`, NaN: unknown."""
    evidence, whitener = search.evidence, search.whitener
    fold, names = asked or folds(evidence)
    label = fold[whitener.row]
    before = np.concatenate([evidence.free, *rest], axis=2)
    old, new, force = whitener(before), whitener(added), whitener(evidence.left)
    known = leading(old, old.shape[1])
    return np.array([gain(known, new, force, label == i) for i in range(len(names))]), names


def gain(known: np.ndarray, added: np.ndarray, force: np.ndarray, out: np.ndarray) -> float:
    """Gain of the whitened columns `added` (N, k) on the rows `out` (N,), fitted to the other rows;
    NaN if these do not determine them.

    Directions of the orthonormal `known` (N, d) that the others do not determine are taken out of
    both sides, and so are columns that are in those rows alone, as a load that no other recording
    carries.
    """
    alone = ~added[~out].any(axis=0) & added[out].any(axis=0)
    private, added = added[:, alone], added[:, ~alone]
    rest = beside(known, added)
    own = np.linalg.norm(rest, axis=0) > SINGULAR_SHARE * np.linalg.norm(added, axis=0)
    new = leading(rest[:, own], added.shape[1])
    # Orthonormal columns keep their principal directions on any rows and on the others.
    power, directions = np.linalg.eigh(known[~out].T @ known[~out])
    turned = known @ directions
    determined = power >= HELD_SHARE**2
    held = turned[:, determined]
    lost = np.concatenate([turned[:, ~determined], private], axis=1)
    both = np.concatenate([held, new, force[:, np.newaxis]], axis=1)
    inside, outside = (
        beside(leading(lost[rows], lost.shape[1]), both[rows]) if lost.shape[1] else both[rows]
        for rows in (~out, out)
    )
    k = held.shape[1]
    basis = inside[:, :k] / np.sqrt(power[determined])
    left = beside(basis, inside[:, k:-1])
    if np.linalg.svd(left, compute_uv=False).min(initial=1.0) < HELD_SHARE or not own.any():
        return np.nan
    costs = []  # sums of squares that a fit to the other rows leaves of the force
    for count in (k, k + new.shape[1]):
        columns = inside[:, :count]
        values = np.linalg.solve(columns.T @ columns, columns.T @ inside[:, -1])
        costs.append(float(((outside[:, -1] - outside[:, :count] @ values) ** 2).sum()))
    return costs[0] - costs[1]


def helps(gains: np.ndarray, thresholds: Thresholds) -> bool:
    """Return whether an effect improves the prediction in all but a few folds (NaN: not asked)."""
    asked, method = gains[np.isfinite(gains)], thresholds.method
    failed = int((asked <= 0.0).sum())
    allowed = max(
        (1.0 - method.folds_share) * len(asked), float(len(asked) >= method.folds_to_fail)
    )
    return 2 * len(asked) > len(gains) and failed <= allowed


def predicts(search: Search, rest: Sequence[np.ndarray], added: np.ndarray) -> bool:
    """Return whether columns added to the `rest` predict held-out recordings better."""
    return helps(held_out_gains(search, rest, added)[0], search.thresholds)


# Others in the place of an effect: which explain as much, and how alike they are.


def without(search: Search, subset: Subset, place: int) -> Subset:
    """The set without one of its effects."""
    rest = others(subset, place)
    return (solve(search.projection, rest) or NOTHING) if rest else NOTHING


def marginal(search: Search, subset: Subset) -> list[float]:
    """The loss of gain of the set without each of its effects."""
    places = range(len(subset.numbers))
    return [subset.gain - without(search, subset, place).gain for place in places]


def in_place_of(search: Search, subset: Subset, place: int) -> list[Subset]:
    """The set with each other candidate in the place of one of its effects, best first."""
    projection = search.projection
    candidate = projection.candidates[subset.numbers[place]].candidate
    replaced = extended(projection, without(search, subset, place))
    ranked = sorted(replaced, key=lambda one: -one.gain)
    return [one for one in ranked if projection.candidates[one.numbers[-1]].candidate != candidate]


def with_other(search: Search, subset: Subset, place: int, number: int) -> Subset | None:
    """The set with another candidate at the place of one of its effects."""
    order = (*subset.numbers[:place], number, *subset.numbers[place + 1 :])
    return solve(search.projection, order)


def freedom(search: Search, number: int) -> int:
    """Number of parameters of a candidate, shapes included, and one for what the model lacks."""
    shaped = search.projection.candidates[number]
    return len(shaped.positive) + len(shaped.candidate.shapes) + (not shaped.candidate.changes)


def same_effect(one: Candidate, other: Candidate) -> bool:
    """Return whether both are laws of the same effect, on the same joint."""
    return one.joint == other.joint and other.type in one.effect.kin


def likeness(search: Search, one: int, others: Sequence[int]) -> np.ndarray:
    """Cosines (m,) of the largest angles between the columns of one candidate and those of each of
    m others, beside the base: of the column that the other fits worst, within the signs of its
    parameters.
    """
    projection, out = search.projection, np.full(len(others), np.inf)
    own, gram, free = projection.columns_of[one], projection.gram, ~projection.positive
    counts = np.array([len(projection.columns_of[other]) for other in others], dtype=int)
    for count in np.unique(counts):
        places = np.flatnonzero(counts == count)
        columns = np.stack([projection.columns_of[others[place]] for place in places.tolist()])
        bound = np.ones(len(places), dtype=bool)
        if len(own) > 1 and count > 1 and free[own].all():
            bound = ~free[columns].all(axis=1)
            out[places[~bound]] = [_least_canonical(gram, own, each) for each in columns[~bound]]
        places, columns = places[bound], columns[bound]
        all_own = np.broadcast_to(own, (len(places), len(own)))
        for few, many in ((all_own, columns), (columns, all_own)):
            for column in few.T if few.shape[1] <= many.shape[1] else ():
                backwards = np.where(free[column], _followed(projection, -1.0, column, many), 0.0)
                cosine = np.maximum(_followed(projection, 1.0, column, many), backwards)
                out[places] = np.minimum(out[places], cosine)
    return out


def _least_canonical(gram: np.ndarray, one: np.ndarray, other: np.ndarray) -> float:
    """Least canonical correlation of two sets of columns."""
    roots = [np.linalg.cholesky(gram[np.ix_(c, c)] + 1e-12 * np.eye(len(c))) for c in (one, other)]
    mixed = np.linalg.solve(roots[0], np.linalg.solve(roots[1], gram[np.ix_(other, one)]).T)
    return float(np.linalg.svd(mixed, compute_uv=False).min())


def _followed(
    projection: Projection, sign: float, column: np.ndarray, others: np.ndarray
) -> np.ndarray:
    """Cosines (m,) between columns (m,) of that sign and the nearest forces of others (m, k)."""
    inner = sign * projection.gram[others, column[:, np.newaxis]]
    blocks = projection.gram[others[:, :, np.newaxis], others[:, np.newaxis]]
    values, apart = constrained(blocks, inner, projection.positive[others])
    power = np.einsum("mk,mk->m", values, inner)
    return np.where(apart, np.sqrt(np.maximum(power, 0.0)), 0.0)


def simplest(search: Search, subset: Subset, threshold: float, settled: int = 0) -> Subset:
    """The set with simpler effects, after the first `settled`, where they are as good."""
    method = search.thresholds.method
    for place in range(settled, len(subset.numbers)):
        own, swaps = subset.numbers[place], in_place_of(search, subset, place)
        needed = max(threshold, method.lead_share * search.unexplained_beside(subset, place))
        for swapped in swaps:
            other = swapped.numbers[-1]
            if subset.gain - swapped.gain > needed:
                break
            simpler = freedom(search, other) < freedom(search, own)
            if simpler and likeness(search, own, [other])[0] > method.form_correlation:
                subset = with_other(search, subset, place, other) or subset
                break
    return subset


# The judgement of an effect, and why it is rejected.

BETWEEN = {"time", "recording"}  # by which recordings differ


class Reason(Enum):
    """Test that an effect does not pass. In brackets: what is measured; its limit."""

    SCORE = "score"  # [2 dlogL; threshold]
    STRENGTH = "strength"  # [rms over that of the drive force; that of processing errors]
    HELD_OUT = "held-out parts"  # [parts that it predicts better; parts that it was not fitted to]
    FORM = "form of another effect"  # what another model form of a stronger effect would leave
    RIVALS = "rivals"  # effects that look different are as good
    SIGNATURE = "signature"  # another signature explains more than any curve of the effect
    CLOSED = "closed"  # [share of the held-out gap that it closes; share that is asked for]
    RESEMBLANCE = "resemblance"  # [share that it explains of what can be explained; least share]
    WIDENED = "widened"  # the held-out error does not fall where the effect acts


class HeldOutChange(NamedTuple):
    """Held-out error of the force of a joint, over its rms, before and after a change."""

    joint: str
    before: float
    after: float


class Rejection(NamedTuple):
    """A test that an effect does not pass, what was `measured`, and the `limit`. `about`: labels of
    effects or signatures that are compared; `errors`: held-out errors where the effect acts.
    """

    reason: Reason
    measured: float = np.nan
    limit: float = np.nan
    about: tuple[str, ...] = ()
    errors: tuple[HeldOutChange, ...] = ()


class Beyond(NamedTuple):
    """A `signature` on a `joint` that no effect has, or `effects` that a test rejects."""

    joint: str = ""
    signature: str = ""
    effects: tuple[str, ...] = ()
    rejections: tuple[Rejection, ...] = ()


class Rival(NamedTuple):
    """Another effect in the place of one that has so much `lead`, where `needed` is asked for."""

    candidate: Candidate
    lead: float
    needed: float


@dataclass(frozen=True)
class Judged:
    """An effect that was weighed against chance, held-out recordings and others in its place.

    `score`: 2 dlogL that the set loses without it; `held_out`: gains of the folds `fold_names`.
    `runner_up`: the best candidate in its place, which is `margin` behind, where `needed` is asked;
    `correlation` of its columns with those of the effect; `indistinct`: all that cannot be told
    from it; `rivals`: all that are not but the same with more freedom. `strength`: rms of what the
    effect explains over that of its joint's force.
    """

    shaped: ShapedCandidate
    score: float
    threshold: float
    held_out: np.ndarray
    fold_names: tuple[str, ...]
    runner_up: Candidate | None
    margin: float
    needed: float
    correlation: float
    indistinct: tuple[Candidate, ...]
    strength: float
    rivals: tuple[Rival, ...] = ()


def all_judged(search: Search, subset: Subset) -> list[Judged]:
    """The effects of a set, each against what chance adds to the best smaller set."""
    threshold = by_chance(search, search.sets[len(subset.numbers) - 1][0])
    return [
        _judged(search, subset, place, score, threshold)
        for place, score in enumerate(marginal(search, subset))
    ]


def found_values(search: Search, subset: Subset, place: int) -> np.ndarray:
    """The parameters (k,) that a set gives to one of its effects."""
    columns = [search.projection.columns_of[number] for number in subset.numbers]
    begin, own = sum(map(len, columns[:place])), columns[place]
    return np.asarray(subset.values[begin : begin + len(own)] / search.projection.scale[own])


def folds_asked(search: Search, own: ShapedCandidate, values: np.ndarray) -> Folds:
    """The folds in which an effect must help: where it acts, or all if recordings differ."""
    if BETWEEN & set(own.candidate.effect.follows):
        return folds(search.evidence)
    return folds_of(search.evidence, search.whitener, own.columns @ values)


def _judged(search: Search, subset: Subset, place: int, score: float, threshold: float) -> Judged:
    projection, method = search.projection, search.thresholds.method
    number = subset.numbers[place]
    own = projection.candidates[number]
    replaced = in_place_of(search, subset, place)
    cosines = likeness(search, number, [swapped.numbers[-1] for swapped in replaced]).tolist()
    swaps = []
    for swapped, alike in zip(replaced, cosines, strict=True):
        related = same_effect(own.candidate, projection.candidates[swapped.numbers[-1]].candidate)
        if related or alike > method.rival_correlation:
            swaps.append((swapped, alike, related))
    left = search.unexplained_beside(subset, place)
    # Beyond noise, what is left unexplained, and columns that are not quite those of the machine.
    needed = max(threshold, method.lead_share * left, (1.0 - method.alike_correlation**2) * score)
    needed_of_same = max(needed, method.kin_lead_share * left)
    rivals: list[Rival] = []
    for swapped, alike, related in swaps:
        other = projection.candidates[swapped.numbers[-1]]
        if other.shape or other.candidate.changes:
            form = method.form_correlation
        else:
            form = IDENTICAL_CORRELATION if own.candidate.changes else np.inf
        more = freedom(search, swapped.numbers[-1]) > freedom(search, number)
        if more and alike > form and not related:
            continue  # the same with more freedom, which it does not need
        asked_of = needed_of_same if related else needed
        rivals.append(Rival(other.candidate, subset.gain - swapped.gain, asked_of))
    indistinct = [one.candidate for one in rivals if one.lead <= one.needed]
    rest = [projection.candidates[i].columns for i in without(search, subset, place).numbers]
    found = found_values(search, subset, place)
    asked = folds_asked(search, own, found)
    held_out, names = held_out_gains(search, rest, own.columns[:, :, found != 0.0], asked)
    first, correlation, closest = swaps[0] if swaps else (None, 0.0, False)
    return Judged(
        shaped=own,
        score=score,
        threshold=threshold,
        held_out=held_out,
        fold_names=names,
        runner_up=projection.candidates[first.numbers[-1]].candidate if first else None,
        margin=subset.gain - first.gain if first else score,
        needed=needed_of_same if closest else needed,
        correlation=correlation,
        indistinct=tuple(indistinct),
        strength=search.strength(number, score),
        rivals=tuple(rivals),
    )
