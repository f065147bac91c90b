"""What chance alone explains, and the score that is asked for because of it."""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.search.projection import Projection
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset
from crane_identification.thresholds import Thresholds

REPLICATES = 500
SEED = 20250101


def null_gains(
    projection: Projection, numbers: Sequence[int], replicates: int = REPLICATES
) -> np.ndarray:
    """(replicates,) largest gain of any candidate beside those with these numbers, from noise.

    Parametric bootstrap: the noise of whitened rows is white, so that the inner products with the
    columns are jointly normal with their Gram matrix as covariance, and need no rows at all.
    """
    columns_of = projection.columns_of
    inside = [int(c) for i in numbers for c in columns_of[i]]
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
    # Of several parameters, what all gain together; of those with signs at most, and at most the
    # sum of their parts, since alike columns only take from each other.
    totals = np.zeros((len(projection.candidates), replicates))
    np.add.at(totals, projection.owner, gains)
    for count, (several, columns) in projection.by_count.items():
        if count > 1:
            blocks = gram[columns[:, :, np.newaxis], columns[:, np.newaxis]]
            inverse = np.linalg.pinv(blocks, rcond=1e-9, hermitian=True)
            own = score[columns]
            free = np.einsum("mkr,mkr->mr", own, inverse @ own)
            signed = projection.positive[columns].all(axis=1)[:, np.newaxis]
            totals[several] = np.where(signed, np.minimum(totals[several], free), free)
    return totals.max(axis=0)


def by_chance(search: Search, before: Subset, thresholds: Thresholds) -> tuple[np.ndarray, float]:
    """The gains (replicates,) that chance adds to a set, and the gain asked of an effect there."""
    null = null_gains(search.projection, before.numbers)
    level = 1.0 - thresholds.method.false_alarm_rate / 2.0
    return null, thresholds.gates.score_factor * float(np.quantile(null, level))
