"""What the position sensor would have told, had it known all that came later."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from crane_model.array import Array
from crane_observer.position.filter import Filter
from crane_observer.position.hypotheses import Hypotheses, mixed
from crane_observer.position.kalman import Correction, Gaussian, KeptGaussian, Prediction
from crane_observer.position.state import FlowWindow, PoseEstimate

# Backwards over what a filter did: its estimates with all that came later (Rauch-Tung-Striebel).
#
# With d the correction of a mean, and errors e, where e_s = S e + n and N is the covariance of n:
#
#     prediction  C = P F^T (I - S')^T ((I - S') P' (I - S')^T + N')^-1
#                 d = C d'             S = I + C (S' - I) F
#                 N = C (N' + (S' - I) Q (S' - I)^T) C^T
#     correction  K the gain           S = S' (I - K H)
#                 d = d' + x' - x      N = N' + S' K R K^T S'^T
#
# with ' after the step, and P_s = S P S^T + N, which holds for any gains. C is the one with the
# least P_s. Where all states are estimated it is P F^T P'^-1; where some are considered and not
# estimated, of which nothing is learnt in hindsight either, that one would make states less sure.

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


CHAPTER = 200  # windows, which are gone through again at once: all steps of one are kept


class Past:
    """Windows as they were gone through, and what was known at the beginning of each chapter."""

    def __init__(self, begun: Hypotheses):
        self._begun = [begun.copied()]
        self._chapters: list[list[FlowWindow]] = [[]]

    def add(self, window: FlowWindow, after: Hypotheses) -> None:
        """One more window, and what is known after it."""
        self._chapters[-1].append(window)
        if len(self._chapters[-1]) == CHAPTER:
            self._begun.append(after.copied())
            self._chapters.append([])

    def smoothed(self, after: Hypotheses) -> list[PoseEstimate]:
        """Estimates after each window, of the starts that are still possible in the end."""
        courses = [
            _backwards([_of(one, last.start) for one in self._begun], self._chapters)
            for last in after.filters
        ]
        return [mixed(of_one, after.scores) for of_one in zip(*courses, strict=True)]


class _Mark(NamedTuple):
    """After a window."""

    steps: int  # that were kept until then
    state: Gaussian
    told: PoseEstimate


def _of(hypotheses: Hypotheses, start: Array) -> Filter:
    """The filter from this start; a copy has the same one."""
    return next(one for one in hypotheses.filters if one.start is start)


def _backwards(
    begun: Sequence[Filter], chapters: Sequence[Sequence[FlowWindow]]
) -> list[PoseEstimate]:
    known = begun[0].known
    later, found = KnownLater(known.layout.size), list[PoseEstimate]()
    for first, windows in zip(reversed(begun), reversed(chapters), strict=True):
        again = first.copied()
        kept = again.state = KeptGaussian(first.state)
        marks = []
        for window in windows:
            told = again.step(window)
            marks.append(_Mark(len(kept.steps), kept.now(), told))
        for mark in reversed(marks):
            while len(kept.steps) > mark.steps:
                later.back(kept.steps.pop())
            found.append(_told(mark, later.of(mark.state), again))
        while kept.steps:
            later.back(kept.steps.pop())
    found.reverse()
    for k, (before, after) in enumerate(pairwise(found), start=1):
        way = after.position - before.position
        found[k] = after._replace(velocity=way / (after.time - before.time))
    return found


def _told(mark: _Mark, smoothed: Gaussian, of: Filter) -> PoseEstimate:
    """With a load that may hide at rest as it could then."""
    known, told = of.known, of.known.layout.told
    hidden = mark.told.covariance - mark.state.P[np.ix_(told, told)]
    return mark.told._replace(
        position=np.clip(smoothed.x[told[:-1]], known.low, known.high),
        covariance=smoothed.P[np.ix_(told, told)] + hidden,
        load=float(smoothed.x[told[-1]]),
    )
