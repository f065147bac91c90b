"""How large a statistic gets once in a long time, told from the windows of a short one.

What exceeds a high threshold is distributed exponentially beyond it (the generalized Pareto law of
shape 0, to which the maxima of most distributions come: Pickands 1975), so that once in N windows
it exceeds

    u + m log(N s)

with s the share of windows above the threshold u, and m their mean excess over it.
"""

import math

import numpy as np

from crane_model.array import Array

ABOVE = 0.2  # share of the windows that is called high
FEWEST = 10  # windows that tell a mean excess


def level(largest: Array, windows: float) -> float:
    """What a statistic exceeds once in `windows`, told from the largest (n,) in each of n.

    `ValueError` unless there is one.
    """
    if not len(largest):
        raise ValueError("level: no window to tell it from; at least one is wanted")
    high = min(max(round(ABOVE * len(largest)), FEWEST), len(largest))
    ordered = np.sort(largest)
    above = ordered[-high:]
    threshold = ordered[-high - 1] if high < len(ordered) else ordered[0]
    rate = high / len(largest)
    return float(threshold + np.mean(above - threshold) * max(math.log(windows * rate), 0.0))
