"""Does an effect improve the prediction of recordings that its parameters were not fitted to?

It is asked of those in which it acts: elsewhere, chance alone decides.
"""

from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, beside, leading
from crane_identification.diagnosis.search.whitening import Whitener
from crane_identification.thresholds import Thresholds

FEWEST_BAGS = 4  # with fewer, blocks of time take their place
TIME_BLOCKS = 6
HELD_SHARE = 0.2
"""Share of a direction's norm that the other folds must hold to determine its coefficient: the
noise that the fold is predicted with because of it is then five times that of a row at most."""
TINY = np.finfo(float).tiny
ROUNDING_SHARE = 1e-6  # share of a column's norm beside the others, below which it is one of them
ACTING_SHARE = 0.1
"""Share of what a recording would have of the energy of an effect if all had the same, from which
on it acts there."""
FEWEST_ACTING = 3  # recordings in which an effect acts; with fewer, blocks of time take their place
FEWEST_OCCASIONS = 2  # on which it acts there, as into an end and out: what happens once is no law
QUIET_SHARE = 0.01  # of the largest energy of a row: below it, an occasion has ended


class Folds(NamedTuple):
    """The fold (n,) of each row, -1 where it is in none, and the names of the folds."""

    fold: np.ndarray
    names: tuple[str, ...]


def folds(evidence: Evidence) -> Folds:
    """Recordings, or blocks of time."""
    names = list(dict.fromkeys(run.source for run in evidence.runs))
    if len(names) >= FEWEST_BAGS:
        return Folds(evidence.bag, tuple(names))
    order = np.arange(len(evidence.time))
    return _blocks(order * TIME_BLOCKS // len(order), TIME_BLOCKS)


def folds_of(evidence: Evidence, whitener: Whitener, force: np.ndarray) -> Folds:
    """Those in which an effect of this `force` (n, c) acts: recordings or, of too few of these,
    blocks of time within them, each with as much of its energy. All where it acts but once.
    """
    every = folds(evidence)
    if len(evidence.sources) < FEWEST_BAGS:
        return every
    power = np.bincount(whitener.row, whitener(force) ** 2, len(force))
    share = np.bincount(evidence.bag, power, len(every.names)) / max(power.sum(), TINY)
    acting = share * len(every.names) > ACTING_SHARE
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
    evidence: Evidence,
    whitener: Whitener,
    before: np.ndarray,
    added: np.ndarray,
    asked: Folds | None = None,
) -> tuple[np.ndarray, tuple[str, ...]]:
    """2 dlogL of each fold that is `asked`, of all if none is given, that the columns `added`
    (n, j, k) gain beside `before`.

    NaN for a fold without which the others do not tell the columns from those before.
    """
    fold, names = asked or folds(evidence)
    label = fold[whitener.row]
    old, new, force = whitener(before), whitener(added), whitener(evidence.left)
    known = leading(old, old.shape[1])
    return np.array([_gain(known, new, force, label == i) for i in range(len(names))]), names


def gain(before: np.ndarray, added: np.ndarray, force: np.ndarray, out: np.ndarray) -> float:
    """What the whitened columns `added` (N, k) gain on the rows `out` (N,), fitted to the others.

    NaN where the others do not determine them. Directions of `before` (N, d) that the others do not
    determine, as a nuisance of one recording, are taken out of both sides, with and without the
    columns: nothing predicts them. So are columns that are in those rows alone, as a load which no
    other recording carries: the rest is predicted better where the others have theirs.
    """
    return _gain(leading(before, before.shape[1]), added, force, out)


def _gain(known: np.ndarray, added: np.ndarray, force: np.ndarray, out: np.ndarray) -> float:
    """The same beside the orthonormal columns `known` (N, d)."""
    alone = ~added[~out].any(axis=0) & added[out].any(axis=0)
    private, added = added[:, alone], added[:, ~alone]
    rest = beside(known, added)
    own = np.linalg.norm(rest, axis=0) > ROUNDING_SHARE * np.linalg.norm(added, axis=0)
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
    costs = [_left(inside, outside, count) for count in (k, k + new.shape[1])]
    return costs[0] - costs[1]


def _left(inside: np.ndarray, outside: np.ndarray, count: int) -> float:
    """Sum of squares of the last column outside that its fit by the first `count` inside leaves.

    Those are far from combinations of each other.
    """
    gram = inside[:, :count].T @ inside[:, :count]
    values = np.linalg.solve(gram, inside[:, :count].T @ inside[:, -1])
    return float(((outside[:, -1] - outside[:, :count] @ values) ** 2).sum())


def helps(gains: np.ndarray, thresholds: Thresholds) -> bool:
    """Whether an effect improves the prediction of recordings that it was not fitted to.

    In all folds (NaN: not asked) but a few; of four and more, one may differ in something else.
    Folds are counted: how much one of them gains or loses decides nothing.
    """
    asked, method = gains[np.isfinite(gains)], thresholds.method
    failed = int((asked <= 0.0).sum())
    allowed = max(
        (1.0 - method.folds_share) * len(asked), float(len(asked) >= method.folds_to_fail)
    )
    return 2 * len(asked) > len(gains) and failed <= allowed
