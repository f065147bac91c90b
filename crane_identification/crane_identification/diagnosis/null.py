"""How large the best gain of all families becomes when nothing is missing."""

import numpy as np

from crane_identification.diagnosis.projection import Projection

REPLICATES = 500
SEED = 20250101


def null_gains(
    projection: Projection, inside: list[int], replicates: int = REPLICATES
) -> np.ndarray:
    """(replicates,) largest gain of any option beside the columns `inside`, from noise alone.

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
    # Options with several parameters gain the sum of their parts at most.
    totals = np.zeros((len(projection.options), replicates))
    np.add.at(totals, projection.owner, gains)
    return totals.max(axis=0)
