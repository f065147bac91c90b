"""Whether standard deviations of a recording are right, whose errors stay from sample to sample."""

import numpy as np
from scipy.stats import chi2
from statsmodels.tsa.stattools import acf

SURE = 0.95
WHOLE = 5.0  # correlation times, over which correlations are summed (Sokal)


def independent(squared: np.ndarray) -> float:
    """How many independent samples tell as much of the mean of (n,) as these do."""
    if np.ptp(squared) == 0.0:
        return 1.0
    correlation = acf(squared, nlags=len(squared) // 2, fft=True)
    times = 2.0 * np.cumsum(correlation) - 1.0
    far = np.arange(len(times)) >= WHOLE * times
    time = times[int(np.argmax(far))] if far.any() else times[-1]
    return float(np.clip(len(squared) / max(time, 1.0), 1.0, len(squared)))


def in_band(squared: np.ndarray, dimension: int) -> bool:
    """Whether the mean of normalised errors squared (n,) is within the 95 % band that it has where
    errors of that dimension are as large as they are said to be.
    """
    freedom = dimension * independent(squared)
    low, high = chi2.ppf([(1.0 - SURE) / 2.0, (1.0 + SURE) / 2.0], freedom) / freedom
    return bool(low <= squared.mean() / dimension <= high)
