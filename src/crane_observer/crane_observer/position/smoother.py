"""Backwards over what a filter did: its estimates with all that came later (Rauch-Tung-Striebel).

With d the correction of a mean, and errors e, where e_s = S e + n and N is the covariance of n:

    prediction  C = P F^T (I - S')^T ((I - S') P' (I - S')^T + N')^-1
                d = C d'             S = I + C (S' - I) F
                N = C (N' + (S' - I) Q (S' - I)^T) C^T
    correction  K the gain           S = S' (I - K H)
                d = d' + x' - x      N = N' + S' K R K^T S'^T

with ' after the step, and P_s = S P S^T + N, which holds for any gains. C is the one with the least
P_s. Where all states are estimated it is P F^T P'^-1; where some are considered and not estimated,
of which nothing is learnt in hindsight either, that one would make states less sure.
"""

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from crane_model.array import Array
from crane_observer.position.gaussian import Correction, Gaussian, Prediction

RIDGE = 1e-11  # of a variance, where states are known to move as one


class KnownLater:
    """What is known at a moment with all that came later; at first nothing came."""

    def __init__(self, size: int):
        self._d, self._S, self._N = np.zeros(size), np.eye(size), np.zeros((size, size))

    def of(self, state: Gaussian) -> Gaussian:
        """That of a state which the filter had at this moment."""
        P = self._S @ state.P @ self._S.T + self._N
        return Gaussian(state.x + self._d, 0.5 * (P + P.T), state.estimated)

    def back(self, step: Prediction | Correction) -> None:
        """To before a step."""
        if isinstance(step, Correction):
            self._correct(step)
        else:
            self._predict(step)

    def _predict(self, step: Prediction) -> None:
        P, F, after = step.before.P, step.F, step.after.P
        away = self._S - np.eye(len(after))
        learnt = away @ after @ away.T + self._N
        known = slice(step.before.estimated)
        scale = 1.0 / np.sqrt(np.diag(after)[known])
        alike = learnt[known, known] * np.outer(scale, scale) + RIDGE * np.eye(len(scale))
        shared = (away @ F @ P)[known, known] * scale[:, np.newaxis]
        C = np.zeros_like(P)
        C[known, known] = -cho_solve(cho_factor(alike), shared).T * scale
        noise = after - F @ P @ F.T
        self._N = C @ (self._N + away @ noise @ away.T) @ C.T
        self._S = np.eye(len(after)) + C @ away @ F
        self._d = C @ self._d

    def _correct(self, step: Correction) -> None:
        kept, noise = closed(step.before.P, step.H, step.variance, step.before.estimated)
        self._N = self._N + self._S @ noise @ self._S.T
        self._S = self._S @ kept
        self._d = self._d + step.after.x - step.before.x


def transition(step: Prediction | Correction) -> Array:
    """(size, size) of errors over a step: e' = S e + noise."""
    if isinstance(step, Prediction):
        return step.F
    return closed(step.before.P, step.H, step.variance, step.before.estimated)[0]


@njit(cache=True, error_model="numpy")
def closed(P: Array, H: Array, variance: Array, estimated: int) -> tuple[Array, Array]:
    """I - K H and K R K^T of what `crane_observer.position.kalman.correct` does to P (n, n)."""
    n = len(P)
    P, kept, noise = P.copy(), np.eye(n), np.zeros((n, n))
    for r in range(len(variance)):
        if not np.isfinite(variance[r]):
            continue
        seen = P @ H[r]
        gain = seen / (H[r] @ seen + variance[r])
        gain[estimated:] = 0.0
        step = np.eye(n) - np.outer(gain, H[r])
        kept = step @ kept
        noise = step @ noise @ step.T + variance[r] * np.outer(gain, gain)
        P = step @ P @ step.T + variance[r] * np.outer(gain, gain)
    return kept, noise
