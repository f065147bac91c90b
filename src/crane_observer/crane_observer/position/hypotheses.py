"""Several starts beside each other, until what follows tells which is true."""

import math
from collections.abc import Sequence
from copy import copy
from itertools import product
from typing import Self

import numpy as np

from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_observer.position.balance import Known
from crane_observer.position.filter import Filter
from crane_observer.position.flow import MOST_BY_WEIGHT
from crane_observer.position.state import POSITION, FlowWindow, PoseEstimate, StateLayout

# Which joints the force balance tells, whatever is believed of them: from what it said lately.
#
# The information about all states, half of it forgotten in some time, with what is known of a
# model's errors and nothing of positions and load; a position is observable where this bounds it.

MEMORY = 30.0  # s
WIDE = 0.02  # of the range of a joint, one standard deviation, up to which it is observable
HEAVIEST = 200.0  # kg, what may hang at the tip


class Observability:
    """Of one model, whose joints have a `span` (j,) and errors a `spread` (size,)."""

    def __init__(self, layout: StateLayout, span: Array, spread: Array, heaviest: float = HEAVIEST):
        self._layout, self._span = layout, span
        known = spread.copy()
        known[layout.of(POSITION)], known[layout.load] = span, heaviest
        self._prior = np.diag(1.0 / known**2)
        self._information = np.zeros((layout.size, layout.size))

    def add(self, rows: Array, duration: float) -> None:
        """Those of unit variance with slopes `rows` (r, size), `duration` [s] after the last."""
        self._information *= math.exp(-duration / MEMORY)
        self._information += rows.T @ rows

    @property
    def deviation(self) -> Array:
        """(j,) of each position, by the force balance alone."""
        every = np.linalg.inv(self._information + self._prior)
        return np.sqrt(np.diag(every)[self._layout.of(POSITION)])

    @property
    def observable(self) -> Flags:
        """(j,) whether the position of each joint is bounded by it."""
        return np.asarray(self.deviation < WIDE * self._span)


# Which joints are served without their encoders where valves are not identified.

POSES = 256  # that are looked at


def refuse_unserved(model: Model, hidden: Flags) -> list[str]:
    """`ConfigurationError` where joints whose encoders are `hidden` (j,) cannot be served;
    else what is to be said of those that are served by their weight alone.
    """
    known = Known.of(model, np.zeros(len(model.joints)))
    by_weight = hidden & known.assumed
    names = [joint for joint, one in zip(model.joints, by_weight, strict=True) if one]
    if len(names) > MOST_BY_WEIGHT:
        raise ConfigurationError(
            f"the valves of {', '.join(names)} are not identified, and the weight of the crane "
            f"tells the position of {MOST_BY_WEIGHT} joint at most: identify the hydraulics, or "
            "use the other encoders"
        )
    poor = by_weight & ~told_by_weight(known)
    if poor.any():
        raise ConfigurationError(
            f"{model.joints[int(np.argmax(poor))]}: its valve is not identified, and the weight of "
            "the crane is about the same wherever it is: identify the hydraulics"
        )
    return [
        f"{joint}: its valve is not identified; its position comes from the weight of the crane "
        "while it moves steadily, and drifts where it does not"
        for joint in names
    ]


def told_by_weight(known: Known) -> Flags:
    """(j,) whether in some pose the weight bounds the position of each joint."""
    rng = np.random.default_rng(0)
    q = known.low + (known.high - known.low) * rng.uniform(size=(POSES, len(known.low)))
    still = np.zeros_like(q)
    slope = known.mechanics.balance(q, still, still).slope
    lever = known.mechanics.cylinders(q)[:, :, 1]
    noise: Array = lever * known.circuit.area_a * known.trust.pressure
    told = np.nansum((slope / noise[:, :, np.newaxis]) ** 2, axis=1).max(axis=0)
    return np.asarray(told > 1.0 / (WIDE * (known.high - known.low)) ** 2)


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
