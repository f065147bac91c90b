"""How far sums of residuals went over windows of all lengths, beside how far they may.

The largest share over all windows that end now is a test for a change of the mean that began at any
time within them (a window-limited generalized likelihood ratio), whose deviation grows with what
was moved as `crane_observer.monitor.tolerance` has it.
"""

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import History, Sums

Rows = NDArray[np.int64]
SPANS = 2 ** np.arange(11)  # blocks, over which sums are looked at: from 0.05 to 51 s


def between(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and how far they may by tolerances (c, 6), or
    (6,) that all share.
    """
    moved, by = grown(sums, begin, end)
    return moved, np.asarray((by * tolerance).sum(axis=-1))


def grown(sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and (n, c, 6) what floor, share, zero,
    creep, late and edge are multiplied by.
    """
    moved = np.abs(sums.residual[end] - sums.residual[begin])
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    late, edge = np.abs(sums.turned[end] - sums.turned[begin]), sums.edge[end] - sums.edge[begin]
    ones = np.ones_like(way)
    by = [ones, way, drop, _lasting(begin, end) * ones, late, np.abs(edge)]
    return moved, np.stack(by, axis=-1)


def within(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> Array:
    """(n, c) how far they may if stamps and spools are right, by tolerances (c, 4) of the rest."""
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    floor, share, zero, creep = tolerance.T
    return np.asarray(floor + share * way + zero * drop + creep * _lasting(begin, end))


def _lasting(begin: Rows, end: Rows) -> Array:
    """(n, 1) s between rows."""
    return np.asarray(BLOCK * np.abs(end - begin)[:, None])


def excess(tolerance: Array, history: History) -> tuple[Array, Array]:
    """(c,) the largest share of its tolerance that a sum of each channel takes up to the newest
    block, and the number of blocks over which it does.
    """
    sums, now = history.sums, history.newest
    spans = SPANS[now >= SPANS]
    if not len(spans):
        return np.zeros(len(tolerance)), np.ones(len(tolerance), dtype=int)
    moved, may = between(tolerance, sums, now - spans, np.full(len(spans), now))
    begun = (now - spans)[:, None] >= history.since_row
    taken = np.where(begun, moved / may, 0.0)
    worst = taken.argmax(axis=0)
    return taken[worst, np.arange(len(tolerance))], spans[worst]


def taken(tolerance: Array, sums: Sums) -> Array:
    """(n, c) the same share at each block of a recording."""
    most = np.zeros_like(sums.residual)
    for span in SPANS[len(sums.time) > SPANS]:
        begin = np.arange(len(sums.time) - span)
        moved, may = between(tolerance, sums, begin, begin + span)
        most[span:] = np.maximum(most[span:], moved / may)
    return most
