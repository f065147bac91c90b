"""Rates and medians with 95 % intervals."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest, bootstrap

from crane_model.result_file import Number, ResultPart

FEWEST = 3  # values, below which a median has no interval

Interval = tuple[float, float]
"""Both ends."""


class Rate(ResultPart):
    """How often something was so."""

    count: int
    """Times [-]."""
    of: int
    """Cases [-]."""
    rate: Number
    """`count` over `of` [-]; null of nothing."""
    interval: Interval | None
    """Wilson's, 95 % [-]."""


class Median(ResultPart):
    """The middle of what was measured."""

    of: int
    """Values [-]."""
    median: Number
    """Of the values [of the values]; null of nothing."""
    interval: Interval | None
    """By the bootstrap, 95 % [of the values]; null of few values."""


def rate(hits: Sequence[bool]) -> Rate:
    """Share of true values."""
    count, n = int(np.sum(hits)), len(hits)
    if n == 0:
        return Rate(count=0, of=0, rate=None, interval=None)
    interval = binomtest(count, n).proportion_ci(method="wilson")
    both = float(interval.low), float(interval.high)
    return Rate(count=count, of=n, rate=count / n, interval=both)


def median(values: Sequence[float]) -> Median:
    """Median of the finite values."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if len(finite) == 0:
        return Median(of=0, median=None, interval=None)
    interval = None
    if len(finite) >= FEWEST:
        found = bootstrap(
            (finite,), np.median, method="percentile", rng=np.random.default_rng(1)
        ).confidence_interval
        interval = float(found.low), float(found.high)
    return Median(of=len(finite), median=float(np.median(finite)), interval=interval)
