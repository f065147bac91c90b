"""Whether standard deviations of a recording are right, whose errors stay from window to window.

A filter that is right makes errors e with covariance P, so that the normalised error squared
(NEES) e^T P^-1 e of d errors has mean d at each moment (Bar-Shalom, Li and Kirubarajan, Estimation
with Applications to Tracking and Navigation, 2001, 5.4). They test it over independent runs: the
errors of one run are not independent, and its mean in time scatters far more. How much follows
from the same filter. It also says how errors go on, e' = S e + noise, so that normalised errors at
moments k and m, z = L^-1 e with P = L L^T, have the covariance

    R_km = L_k^-1 S_k ... S_(m+1) P_m L_m^-T.

The mean in time of |z|^2 over n moments is then a weighted sum of squares, whose weights are the
eigenvalues of R: it has mean d and, over d, as much variance as chi-square with f = (n d)^2 / |R|^2
degrees of freedom (Satterthwaite 1946), between 1 and n d.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from crane_observer.position.filter import Filter
from crane_observer.position.kalman import KeptGaussian
from crane_observer.position.smoothing import transition

SURE = 0.95
EVERY = 10  # windows, of which one counts: errors stay for longer


class Consistency(NamedTuple):
    """Of normalised errors squared over their dimension, in one recording or several."""

    nees: float  # mean; 1 where standard deviations are right
    freedom: float  # degrees of freedom of that mean

    @property
    def band(self) -> tuple[float, float]:
        """In which the mean of a filter that is right is in 95 of 100 recordings."""
        tails = [(1.0 - SURE) / 2.0, (1.0 + SURE) / 2.0]
        low, high = chi2.ppf(tails, self.freedom) / self.freedom
        return float(low), float(high)

    @property
    def holds(self) -> bool:
        """Whether the mean is in its band."""
        low, high = self.band
        return low <= self.nees <= high


def of_recordings(found: Sequence[Consistency]) -> Consistency:
    """The mean of independent recordings, which scatters less: variances 2 / f add up."""
    nees = float(np.mean([one.nees for one in found]))
    return Consistency(nees, len(found) ** 2 / sum(1.0 / one.freedom for one in found))


class Freedom:
    """Degrees of freedom of the mean NEES of d of the n errors of a filter."""

    def __init__(self, places: np.ndarray):
        """`places` (d,) of these among the errors."""
        self._places = places
        self._on: np.ndarray | None = None  # (n, m d): P_m L_m^-T of all m, as they have gone on
        self._squares = 0.0  # |R|^2
        self._moments = 0

    def add(self, transition: np.ndarray, covariance: np.ndarray) -> None:
        """One more moment: S (n, n) since the last, and P (n, n)."""
        own = self._places
        root = np.linalg.cholesky(covariance[np.ix_(own, own)])
        now = np.linalg.solve(root, covariance[own]).T
        if self._on is None:
            self._on = now
        else:
            self._on = transition @ self._on
            alike = np.linalg.solve(root, self._on[own])
            self._squares += 2.0 * float((alike**2).sum())
            self._on = np.concatenate([self._on, now], axis=1)
        self._squares += len(own)
        self._moments += 1

    @property
    def value(self) -> float:
        """Between 1 and n d."""
        return (self._moments * len(self._places)) ** 2 / self._squares


class FreedomWatch:
    """That of a filter at work, from a time on."""

    def __init__(self, one: Filter, hidden: np.ndarray, since: float):
        """`hidden` (j,) whose errors count, from windows that end after `since` [s] on. The filter
        keeps its steps from now on.
        """
        self._state = one.state = KeptGaussian(one.state)
        self._freedom, self._since = Freedom(np.flatnonzero(hidden)), since
        self._passed, self._windows = np.eye(len(one.state.x)), 0

    def __call__(self, time: float) -> None:
        """A window that ends at `time` [s] is done."""
        for step in self._state.steps:
            self._passed = transition(step) @ self._passed
        self._state.steps.clear()
        if time > self._since and self._windows % EVERY == 0:
            self._freedom.add(self._passed, self._state.P)
            self._passed = np.eye(len(self._passed))
        self._windows += 1

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the mean NEES."""
        return self._freedom.value
