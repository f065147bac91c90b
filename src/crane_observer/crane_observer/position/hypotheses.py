"""Several starts beside each other, until what follows tells which is true."""

from collections.abc import Sequence
from copy import copy
from itertools import product
from typing import Self

import numpy as np

from crane_model.array import Array
from crane_observer.position.filter import Filter
from crane_observer.position.known import Known
from crane_observer.position.window import FlowWindow, PoseEstimate

POINTS = 4  # of the range of each joint whose start is not known
INSIDE = 0.05  # of the range, from its ends to the first and last of them
TEMPERED = 0.1  # of a log likelihood counts: errors of the model are alike from window to window
HOPELESS = 10.0  # of a log likelihood below the best, where a start is given up
ALIKE = 2.0  # standard deviations, within which two are one


class Hypotheses:
    """Filters from several starts; a start that is known is one."""

    def __init__(self, known: Known, position: Array, deviation: Array):
        """`position` (j,) with NaN where it may be anywhere; `deviation` (j,) where it is known."""
        span = known.high - known.low
        steps = np.linspace(INSIDE, 1.0 - INSIDE, POINTS)
        choices: Sequence[Array] = [
            low + width * steps if np.isnan(at) else np.array([at])
            for at, low, width in zip(position, known.low, span, strict=True)
        ]
        spread = np.where(np.isnan(position), span / POINTS, deviation)
        self.filters = [Filter(known, np.array(start), spread) for start in product(*choices)]

    @property
    def scores(self) -> Array:
        """(h,) of the filters, logs."""
        return TEMPERED * np.array([one.likelihood for one in self.filters])

    def copied(self) -> Self:
        """As they stand, to go back to."""
        other = copy(self)
        other.filters = [one.copied() for one in self.filters]
        return other

    def step(self, window: FlowWindow) -> PoseEstimate:
        """After one more window: that of the likeliest, wider by what the others say."""
        estimates = [one.step(window) for one in self.filters]
        if len(estimates) == 1:
            return estimates[0]
        scores = self.scores
        order = np.argsort(-scores)
        kept: list[int] = []
        for i in order:
            if scores[i] < scores[order[0]] - HOPELESS:
                break
            if not any(_alike(estimates[i], estimates[k]) for k in kept):
                kept.append(int(i))
        self.filters = [self.filters[i] for i in kept]
        return mixed([estimates[i] for i in kept], scores[kept])


def mixed(estimates: Sequence[PoseEstimate], scores: Array) -> PoseEstimate:
    """The likeliest, which is the first, wider by what the others say; `scores` (h,) are logs."""
    best, weights = estimates[0], np.exp(scores - scores[0])
    weights /= weights.sum()
    away = [np.append(one.position - best.position, one.load - best.load) for one in estimates]
    apart = sum(w * np.outer(one, one) for w, one in zip(weights, away, strict=True))
    return best._replace(covariance=best.covariance + apart)


def _alike(one: PoseEstimate, other: PoseEstimate) -> bool:
    spread = np.sqrt(np.diag(one.covariance)[:-1] + np.diag(other.covariance)[:-1])
    return bool((np.abs(one.position - other.position) < ALIKE * spread).all())
