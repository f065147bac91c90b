"""Does a prior contradict the recordings? Each entry is left out and predicted by all the rest."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import orth
from scipy.stats import chi2

from crane_identification.estimation.least_squares import meat, spread_of
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import Rows, balancing, solve, solve_weighted
from crane_identification.options import Covariance

LEAST_SPAN_LEFT = 1e-3
"""Weight of an entry that is left out: too small to matter beside data, enough to keep a parameter
that nothing else determines."""
DEPENDENT_POWER = 1e-12
LEAST_SPAN_SHARED = 1e-6
"""Share of a direction that must not belong to other bodies for it to count as a body's own."""
CHANCE = 1e-3
"""Probability of so large a difference by chance, below which an entry is contradicted."""
CHANGED = 2.0
"""Standard deviations by which a parameter must move for its change to be reported."""


class ParameterChange(NamedTuple):
    """A parameter with an entry of the prior, and its value and standard deviation without it."""

    parameter: str
    unit: str
    with_entry: float
    without: float
    std_dev: float


class Contradiction(NamedTuple):
    """An entry of a prior that recordings and all entries not contradicted rule out.

    `sigmas` is the difference in standard deviations of both, the root mean square over `freedom`
    independent directions. `changes` are those of the fit without this entry alone, largest first.
    """

    entry: str
    known: str
    sigmas: float
    freedom: int
    changes: tuple[ParameterChange, ...]


class PriorConflict(NamedTuple):
    """All `contradictions`, the largest first, and the `changes` without all these entries."""

    contradictions: tuple[Contradiction, ...]
    changes: tuple[ParameterChange, ...]


def check_prior(rows: Rows, prior: Prior, covariance: Covariance) -> PriorConflict:
    """Entries of `prior` that the recordings contradict, with noise as `covariance` assumes.

    The worst entry is left out, and the others are judged without it, until none is contradicted: a
    wrong entry would bend the values by which a right one is judged.
    """
    check, entries = _PriorCheck(rows, prior, covariance), prior.entries
    left_out: set[int] = set()
    while rest := [k for k in range(len(entries)) if k not in left_out]:
        differences = {k: check.difference(k, left_out) for k in rest}
        worst = max(rest, key=lambda k: differences[k].over_chance)
        if differences[worst].over_chance <= 1.0:
            break
        left_out.add(worst)
    judged = {k: check.difference(k, left_out) for k in left_out}
    found = sorted(
        (k for k in judged if judged[k].over_chance > 1.0), key=lambda k: -judged[k].sigmas
    )
    return PriorConflict(
        tuple(
            Contradiction(
                entries[k].name,
                entries[k].known,
                judged[k].sigmas,
                judged[k].freedom,
                check.changes({k}),
            )
            for k in found
        ),
        check.changes(set(found)),
    )


class _Posterior(NamedTuple):
    values: np.ndarray  # (p,)
    covariance: np.ndarray  # (p, p)


class _Difference(NamedTuple):
    """Between an entry and all others: squared Mahalanobis distance, independent directions."""

    square: float
    freedom: int

    @property
    def sigmas(self) -> float:
        return float(np.sqrt(self.square / self.freedom))

    @property
    def over_chance(self) -> float:
        """The distance over that which chance exceeds with the probability `CHANCE`."""
        return self.square / float(chi2.isf(CHANCE, self.freedom))


class _PriorCheck:
    def __init__(self, rows: Rows, prior: Prior, covariance: Covariance) -> None:
        self._rows, self._prior = rows, prior
        weights = np.broadcast_to(balancing(rows), rows.force.shape)
        alone = solve_weighted(rows, weights)
        augmented = np.column_stack([rows.stacked, rows.force[rows.used]])
        triangle = np.asarray(np.linalg.qr(augmented * weights[rows.used][:, None], mode="r"))
        self._matrix, self._force = triangle[:, :-1], triangle[:, -1]
        self._noise = meat(rows, weights, alone.values, covariance)
        # Noise that is correlated from row to row makes rows count for fewer than they are.
        rank = np.count_nonzero(np.diag(alone.bread))
        spread = spread_of(rows, weights, alone.values, alone.bread, covariance)
        self._excess = float(np.trace(spread.likely @ (self._matrix.T @ self._matrix))) / rank

    def changes(self, left_out: set[int]) -> tuple[ParameterChange, ...]:
        """Parameters that move if these entries are left out, the largest change first."""
        before, after = self._posterior(set()), self._posterior(left_out)
        std_devs = np.sqrt(np.diag(after.covariance))
        moved = np.abs(after.values - before.values) / np.maximum(std_devs, np.finfo(float).tiny)
        return tuple(
            ParameterChange(
                self._rows.names[i],
                self._rows.units[i],
                float(before.values[i]),
                float(after.values[i]),
                float(std_devs[i]),
            )
            for i in np.argsort(-moved)
            if moved[i] > CHANGED
        )

    def _posterior(self, left_out: set[int]) -> _Posterior:
        """Θ by the recordings and the prior without some of its entries."""
        matrix, values = self._prior.matrix, self._prior.values
        if left_out:
            span = self._span(left_out)
            kept = np.eye(len(matrix)) - (1.0 - LEAST_SPAN_LEFT) * span @ span.T
            matrix, values = kept @ matrix, kept @ values
        size = np.sqrt(self._excess)
        found = solve(
            np.vstack([self._matrix, size * matrix]),
            np.concatenate([self._force, size * values]),
            DEPENDENT_POWER,
        )
        carried = size * found.bread @ matrix.T
        noise = found.bread @ self._noise @ found.bread
        return _Posterior(found.values, noise + self._excess * carried @ carried.T)

    def difference(self, k: int, left_out: set[int]) -> _Difference:
        """Entry k against all others but those `left_out`, in directions that are its own."""
        span = self._prior.entries[k].span
        if rest := left_out - {k}:
            taken = self._span(rest)
            left, sizes, _ = np.linalg.svd(span - taken @ (taken.T @ span), full_matrices=False)
            span = left[:, sizes > LEAST_SPAN_SHARED]
        if not span.shape[1]:
            return _Difference(0.0, 1)
        found = self._posterior(left_out | {k})
        seen = span.T @ self._prior.matrix
        difference = span.T @ self._prior.values - seen @ found.values
        spread = np.eye(len(seen)) + seen @ found.covariance @ seen.T
        return _Difference(float(difference @ np.linalg.solve(spread, difference)), len(seen))

    def _span(self, entries: set[int]) -> np.ndarray:
        """(k, r): directions that any of these entries takes part in."""
        return np.asarray(orth(np.hstack([self._prior.entries[k].span for k in entries])))
