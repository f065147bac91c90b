"""Where a residual sits: the quantity that it follows, and the range that carries most of it."""

from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.learner import Features

BINS = 10
ENERGY_SHARE = 0.5  # of the energy that the range must carry


class Region(NamedTuple):
    """`share` of the residual's energy sits where `variable` is within low..high."""

    variable: str
    low: float
    high: float
    share: float


def region(known: Features, residual: np.ndarray, used: np.ndarray) -> Region | None:
    """The quantity whose value says most about the residual (n,) of one joint; None without rows.

    By the share of the variance that lies between bins of equal numbers of rows (correlation
    ratio); the range is the narrowest run of bins with half of the energy.
    """
    if used.sum() < 5 * BINS:
        return None
    best, chosen = -1.0, None
    energy = residual[used] ** 2
    for column, name in enumerate(known.names):
        values = known.values[used, column]
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))
        if len(edges) < 3:
            continue
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        count = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)
        mean = np.bincount(place, residual[used], len(edges) - 1) / count
        power = np.bincount(place, energy, len(edges) - 1)
        between = float((count * mean**2).sum() / max(energy.sum(), np.finfo(float).tiny))
        if between > best:
            best, chosen = between, Region(name, *_narrowest(edges, power))
    return chosen


def _narrowest(edges: np.ndarray, power: np.ndarray) -> tuple[float, float, float]:
    total = max(float(power.sum()), np.finfo(float).tiny)
    for width in range(1, len(power) + 1):
        sums = np.convolve(power, np.ones(width), "valid") / total
        if sums.max() >= ENERGY_SHARE or width == len(power):
            first = int(sums.argmax())
            return float(edges[first]), float(edges[first + width]), float(sums.max())
    raise AssertionError("the whole range carries everything")
