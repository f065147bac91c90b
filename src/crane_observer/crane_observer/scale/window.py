"""Means over a window whose velocity and acceleration fit each other, compiled.

With the weight w(s) = (1 - s^2)^3, s from -1 to 1 over the window, the means of q, q' and q'' are

    Int w q,    -Int w' q,    Int w'' q,

each over Int w: so q is never differentiated, and forces averaged with w balance them.
"""

import numpy as np
from numba import njit

from crane_model.array import Array

FEWEST = 6  # readings in a window
LONGEST = 0.25  # of a window, between two readings
PIECES = 6  # of a window, in which it is seen whether a joint stops or turns


@njit(cache=True, error_model="numpy")
def means(time: Array, values: Array, begin: float, end: float) -> Array:
    """(3, k) means of `values` (n, k) at increasing `time` (n,) [s], of their rate and of the rate
    of that, between `begin` and `end`. Values that are no numbers do not count; NaN of columns
    whose readings do not fill the window.
    """
    out = np.full((3, values.shape[1]), np.nan)
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    half, middle = 0.5 * (end - begin), 0.5 * (begin + end)
    rows = np.empty(last - first, dtype=np.int64)
    for k in range(values.shape[1]):
        count, gap, newest = 0, 0.0, begin
        for i in range(first, last):
            if np.isfinite(values[i, k]):
                gap, newest = max(gap, time[i] - newest), time[i]
                rows[count] = i
                count += 1
        gap = max(gap, end - newest)
        if count < FEWEST or gap > 2.0 * half * LONGEST:
            continue
        # about the chord, whose share is known without an integral
        t0, y0 = time[rows[0]], values[rows[0], k]
        slope = (values[rows[count - 1], k] - y0) / (time[rows[count - 1]] - t0)
        area, level, rate, bend = 0.0, 0.0, 0.0, 0.0
        for c in range(count):
            before = time[rows[c - 1]] if c > 0 else begin
            after = time[rows[c + 1]] if c < count - 1 else end
            share = 0.5 * (after - before) / half
            s = (time[rows[c]] - middle) / half
            inside = max(1.0 - s * s, 0.0)
            away = share * (values[rows[c], k] - y0 - slope * (time[rows[c]] - t0))
            area += share * inside**3
            level += away * inside**3
            rate += away * 6.0 * s * inside**2
            bend += away * inside * (24.0 * s * s - 6.0 * inside)
        out[0, k] = y0 + slope * (middle - t0) + level / area
        out[1, k] = slope + rate / (half * area)
        out[2, k] = bend / (half * half * area)
    return out


@njit(cache=True, error_model="numpy")
def slowest_and_fastest(time: Array, values: Array, begin: float, end: float) -> Array:
    """(2, k): least and largest rate of `values` (n, k) in any of the `PIECES` of the window."""
    out = np.empty((2, values.shape[1]))
    first, last = np.searchsorted(time, begin), np.searchsorted(time, end, side="right")
    edges = np.linspace(begin, end, PIECES + 1)
    for k in range(values.shape[1]):
        rows = np.flatnonzero(np.isfinite(values[first:last, k])) + first
        if len(rows) < 2:
            out[:, k] = np.nan
            continue
        rates = np.diff(np.interp(edges, time[rows], values[rows, k])) * PIECES / (end - begin)
        out[0, k], out[1, k] = rates.min(), rates.max()
    return out
