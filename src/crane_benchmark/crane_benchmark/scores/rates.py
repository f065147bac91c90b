"""Rates and medians with 95 % intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import bootstrap
from statsmodels.stats.proportion import proportion_confint

FEWEST = 3  # values, below which a median has no interval


def rate(hits: Sequence[bool]) -> dict[str, Any]:
    """Share of true values, with Wilson's interval; all None of nothing."""
    count, n = int(np.sum(hits)), len(hits)
    if n == 0:
        return {"count": 0, "of": 0, "rate": None, "interval": None}
    low, high = proportion_confint(count, n, alpha=0.05, method="wilson")
    return {"count": count, "of": n, "rate": count / n, "interval": [float(low), float(high)]}


def median(values: Sequence[float]) -> dict[str, Any]:
    """Median of the finite values, with a bootstrap interval (percentiles)."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if len(finite) == 0:
        return {"of": 0, "median": None, "interval": None}
    interval = None
    if len(finite) >= FEWEST:
        found = bootstrap(
            (finite,), np.median, method="percentile", rng=np.random.default_rng(1)
        ).confidence_interval
        interval = [float(found.low), float(found.high)]
    return {"of": len(finite), "median": float(np.median(finite)), "interval": interval}
