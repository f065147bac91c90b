"""Rows whose noise is independent and of variance one, by an autoregression per channel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from crane_identification.diagnosis.fit.evidence import (
    ROUNDING_SHARE,
    Evidence,
    beside,
    leading,
    says_nothing,
)
from crane_identification.estimation.autoregression import (
    Autoregression,
    predictors_of,
    restricted_likelihood,
)

DIRECTIONS = 60  # of the candidates that the largest model takes, the commonest ones
ROWS_PER_DIRECTION = 12  # a channel with fewer rows does not carry another direction
FORCE_CORRELATION = 0.999
"""A column whose part beyond the base is correlated like this with the residual is the measured
force itself: it explains everything, noise included, and says nothing."""


class _Pick(NamedTuple):
    """Rows of one channel with the same number of used rows directly before them."""

    channel: int
    rows: np.ndarray
    polynomial: np.ndarray
    deviation: float


@dataclass(frozen=True)
class Whitener:
    """Turns rows (n, c, ...) of the evidence into N independent rows of variance one.

    `row`, `channel` and `zone` (N,) say where each comes from; `noise` holds the autoregressions.
    """

    noise: tuple[Autoregression | None, ...]
    picks: tuple[_Pick, ...]
    row: np.ndarray
    channel: np.ndarray
    zone: np.ndarray

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(n, c, ...) to (N, ...)."""
        there = [values[:, channel].any() for channel in range(values.shape[1])]
        parts = []
        for channel, rows, polynomial, deviation in self.picks:
            if not there[channel]:
                parts.append(np.zeros((len(rows), *values.shape[2:])))
                continue
            column = values[:, channel]
            part = sum(a * column[rows - lag] for lag, a in enumerate(polynomial))
            parts.append(part / deviation)
        return np.concatenate(parts)

    def on(self, channels: Sequence[int]) -> Self:
        """The rows of these channels alone."""
        here = np.isin(self.channel, channels)
        return replace(
            self,
            picks=tuple(pick for pick in self.picks if pick.channel in channels),
            row=self.row[here],
            channel=self.channel[here],
            zone=self.zone[here],
        )


def whitener(evidence: Evidence, largest: np.ndarray) -> Whitener:
    """From the residual of the `largest` model: its columns (n, c, K) beside the base.

    Noise is what no model explains: estimated beside a smaller model it would hold the effects
    that are sought, and whitening would remove them.
    """
    noise: list[Autoregression | None] = []
    picks: list[_Pick] = []
    first = np.diff(evidence.run, prepend=-1) != 0
    for c, used in enumerate(evidence.used.T):
        known = leading(evidence.base[used, c], evidence.base.shape[2])
        if says_nothing(used, known):
            noise.append(None)
            continue
        found = _noise(known, largest[:, c], evidence.force[:, c], used, evidence.run)
        noise.append(found)
        before = _used_before(used, first, len(found.polynomial) - 1)
        predictors = predictors_of(found.autocovariance(len(found.polynomial)))
        for m, (polynomial, variance) in enumerate(zip(*predictors, strict=True)):
            rows = np.flatnonzero(used & (before == m))
            if len(rows):
                picks.append(_Pick(c, rows, polynomial, float(np.sqrt(variance))))
    none = np.zeros(0, dtype=int)
    row = np.concatenate([none, *(pick.rows for pick in picks)])
    channel = np.concatenate([none, *(np.full(len(pick.rows), pick.channel) for pick in picks)])
    zone = channel // len(evidence.model.joints)
    return Whitener(tuple(noise), tuple(picks), row, channel, zone)


def _noise(
    known: np.ndarray, columns: np.ndarray, force: np.ndarray, used: np.ndarray, run: np.ndarray
) -> Autoregression:
    """Beside the orthonormal directions `known` of the base, and those of the columns."""
    columns = columns[:, columns.any(axis=0)]
    rest, residual = beside(known, columns[used]), beside(known, force[used])
    norms = np.linalg.norm(rest, axis=0)
    telling = norms > ROUNDING_SHARE * np.linalg.norm(columns[used], axis=0)
    telling[telling] &= np.abs(residual @ rest[:, telling]) < (
        FORCE_CORRELATION * norms[telling] * np.linalg.norm(residual)
    )
    count = min(DIRECTIONS, (int(used.sum()) - known.shape[1]) // ROWS_PER_DIRECTION)
    more = leading(rest[:, telling], count) if count > 0 else rest[:, :0]
    basis = np.zeros((len(used), known.shape[1] + more.shape[1]))
    basis[used] = np.linalg.qr(np.concatenate([known, more], axis=1))[0]
    found = restricted_likelihood(*(_by_run(v, run) for v in (basis, force, used)))
    assert found is not None  # `whitener` asks for more rows than directions
    floor = (1e-9 * np.sqrt((force[used] ** 2).mean())) ** 2  # of a machine without any noise
    return Autoregression(found.polynomial, max(found.variance, floor, np.finfo(float).tiny))


def _used_before(used: np.ndarray, first: np.ndarray, highest: int) -> np.ndarray:
    """(n,) used rows directly before each, of the same run, up to `highest`."""
    count = np.zeros(len(used), dtype=int)
    for k in range(1, len(used)):
        if used[k - 1] and not first[k]:
            count[k] = min(count[k - 1] + 1, highest)
    return count


def _by_run(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(n, ...) to (runs, longest run, ...), padded with zeros."""
    numbers, counts = np.unique(run, return_counts=True)
    out = np.zeros((len(numbers), counts.max(), *values.shape[1:]), dtype=values.dtype)
    for i, number in enumerate(numbers):
        out[i, : counts[i]] = values[run == number]
    return out


class Base(NamedTuple):
    """`basis` B (N, d), such that rows less B B^T of them are beside the whitened base, and the
    `residual` (N,) of the force beside it.
    """

    basis: np.ndarray
    residual: np.ndarray


def whitened_base(evidence: Evidence, whitener: Whitener) -> Base:
    """The base of the evidence, whitened.

    Its basis is orthonormal; but where the values of the model are kept, not all of the columns u
    that they are uncertain by, with standard deviation a, is taken out. The rows have the
    covariance I + a^2 u u^T: they are white again after I - (1 - 1/sqrt(1 + a^2)) u u^T.
    """
    free, force = (whitener(values) for values in (evidence.free, evidence.left))
    basis = leading(free, free.shape[1])
    if evidence.keeps:
        columns = beside(basis, whitener(evidence.uncertain))
        u, a, _ = np.linalg.svd(columns, full_matrices=False)
        basis = np.concatenate([basis, u * np.sqrt(1.0 - 1.0 / np.hypot(1.0, a))], axis=1)
    return Base(basis, beside(basis, force))
