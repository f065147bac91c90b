"""Where a residual sits: the quantity that it follows, and the range that carries most of it."""

from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.features import Features
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.proof.trial import Trial

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


def regions(fit: Fitted, trial: Trial) -> tuple[Region | None, ...]:
    """Where what a model leaves of each joint sits."""
    known, used = fit.evidence.moving.known, fit.evidence.used
    return tuple(
        region(known, trial.residual[:, j], used[:, j]) for j in range(len(fit.before.joints))
    )


def energy_shares(evidence: Evidence, trial: Trial) -> np.ndarray:
    """Share (j,) of the energy beyond noise that each joint carries."""
    channels = np.maximum(trial.energy - evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(evidence.joints)).sum(axis=0)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


def correlation_left(evidence: Evidence, trial: Trial) -> np.ndarray:
    """Correlation (j,) of neighbouring rows of what is left; 0 for white noise."""
    seen = evidence.moving
    left = trial.residual[:, : len(seen.joints)]
    both = seen.used[1:] & seen.used[:-1] & (np.diff(seen.run) == 0)[:, np.newaxis]
    product = np.where(both, left[1:] * left[:-1], 0.0).sum(axis=0)
    power = np.where(seen.used, left**2, 0.0).sum(axis=0)
    share = both.sum(axis=0) / np.maximum(seen.used.sum(axis=0), 1)
    return product / np.maximum(power * share, np.finfo(float).tiny)
