"""Extremes of sampled functions of time, refined between the samples."""

from collections.abc import Callable

import numpy as np

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
STEPS = 30  # shrink a bracket by 5e-7, so a smooth maximum by the square of that


def maxima(
    function: Callable[[np.ndarray], np.ndarray], grid: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest value of each column of `function` over the span of `grid`, and where.

    `function` takes times (m,) and returns (m, k). Every local maximum of the samples is refined
    by golden-section search between its neighbours, so the grid need only be fine enough to
    separate the maxima. Returns times (k,) and values (k,).
    """
    samples = function(grid)
    wall = np.full((1, samples.shape[1]), -np.inf)
    rises = samples > np.vstack([wall, samples[:-1]])
    falls = samples >= np.vstack([samples[1:], wall])
    row, column = np.nonzero(rises & falls)
    pick = np.arange(len(row))
    left = grid[np.maximum(row - 1, 0)]
    right = grid[np.minimum(row + 1, len(grid) - 1)]
    for _ in range(STEPS):
        width = GOLDEN * (right - left)
        inner_left, inner_right = right - width, left + width
        both = function(np.concatenate([inner_left, inner_right]))
        at_left, at_right = both.reshape(2, len(row), -1)[:, pick, column]
        higher_right = at_right > at_left
        left = np.where(higher_right, inner_left, left)
        right = np.where(higher_right, right, inner_right)
    middle = (left + right) / 2
    refined = function(middle)[pick, column]
    on_grid = samples[row, column] >= refined  # a maximum at either end of the span
    time = np.where(on_grid, grid[row], middle)
    value = np.where(on_grid, samples[row, column], refined)
    order = np.lexsort((value, column))  # the largest of each column comes last
    last = np.flatnonzero(np.diff(column[order], append=samples.shape[1]))
    return time[order][last], value[order][last]
