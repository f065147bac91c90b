"""Fewer points of a curve without a visible difference: the extremes of each column of pixels."""

import numpy as np

POINTS = 1500
"""Points kept of a curve: about twice the columns of pixels that a figure has on a screen."""


def thin(time: np.ndarray, values: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Indices of at most `points` samples of a curve (n,) that draw it like all of them.

    Time is cut into points / 2 equal intervals, and the smallest and largest value of each are
    kept. Gaps stay gaps: of a stretch of samples that are not finite, its ends are kept.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    finite = np.isfinite(values)
    bins = max((points - 2) // 2, 1)
    span = time[-1] - time[0]
    column = np.minimum((bins * (time - time[0]) / span).astype(int), bins - 1)
    kept = [np.array([0, n - 1]), np.flatnonzero(finite[1:] != finite[:-1]) + 1]
    index = np.flatnonzero(finite)
    # Sorted by value within each column of pixels: its first and last are the extremes.
    order = index[np.lexsort((values[index], column[index]))]
    firsts = np.flatnonzero(np.diff(column[order], prepend=-1))
    lasts = np.append(firsts[1:], len(order)) - 1 if len(order) else firsts
    return np.unique(np.concatenate([*kept, order[firsts], order[lasts]]))
