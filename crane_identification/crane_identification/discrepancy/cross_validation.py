"""Does an effect improve the prediction of recordings that its parameters were not fitted to?"""

import numpy as np

from crane_identification.discrepancy.evidence import Evidence
from crane_identification.discrepancy.scaling import normed
from crane_identification.discrepancy.whitening import Whitener, leading

FEWEST_BAGS = 4  # with fewer, blocks of time take their place
BLOCKS = 6
KEPT = 0.2  # of how visible an effect is in all folds: with less, the others do not determine it


def folds(evidence: Evidence) -> tuple[np.ndarray, tuple[str, ...]]:
    """The fold (n,) of each row, and the names of the folds: recordings, or blocks of time."""
    names = list(dict.fromkeys(run.source for run in evidence.runs))
    if len(names) >= FEWEST_BAGS:
        return evidence.bag, tuple(names)
    order = np.arange(len(evidence.time))
    block = order * BLOCKS // len(order)
    return block, tuple(f"block {i + 1} of {BLOCKS}" for i in range(BLOCKS))


def held_out_gains(
    evidence: Evidence, whitener: Whitener, before: np.ndarray, added: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """2 dlogL of each held-out fold that the columns `added` (n, j, k) gain beside `before`.

    NaN for a fold without which the others do not tell the columns from those before.
    """
    fold, names = folds(evidence)
    label = fold[whitener.row]
    force, small, new = whitener(evidence.force), whitener(before), whitener(added)
    large = np.concatenate([small, new], axis=1)
    gains = np.full(len(names), np.nan)
    visible = _visible(small, new)
    for number in range(len(names)):
        out = label == number
        if _visible(small[~out], new[~out]) < KEPT * visible:
            continue
        cost = [_left(columns, force, out) for columns in (small, large)]
        gains[number] = cost[0] - cost[1]
    return gains, names


def _visible(before: np.ndarray, added: np.ndarray) -> float:
    """Share of the norm of the columns `added` that is left beside those `before`; the least."""
    known = leading(before, before.shape[1])
    whole = np.linalg.norm(added, axis=0)
    rest = np.linalg.norm(added - known @ (known.T @ added), axis=0)
    return float(np.divide(rest, whole, out=np.zeros_like(rest), where=whole > 0.0).min())


def _left(columns: np.ndarray, force: np.ndarray, out: np.ndarray) -> float:
    """Sum of squares of the rows `out` that a fit to the others leaves."""
    scaled, _ = normed(columns)
    values = np.linalg.lstsq(scaled[~out], force[~out], rcond=1e-9)[0]
    return float(((force[out] - scaled[out] @ values) ** 2).sum())
