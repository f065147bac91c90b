"""One window after another: strokes from flow, corrected by encoders and by the force balance.

    x_i(q+) = x_i(q) + (1 + g_i) s_i + n_i N_i                                       prediction
    L_i F_i = tau_i(q, q', q'') + m h_i(q, q', q'') + c_i d_i + v_i f_i + L_i A_i b_i    balance

with length x_i and lever arm L_i of cylinder i (20), (24), the stroke s_i that its flow makes and
N_i what a null does to it, piston force F_i (19), the model tau_i (16) with dry and viscous
friction d_i and f_i, and h_i for a load of 1 kg. If a joint stands, dry friction may be anything
between its branches, and stays what it is: counted anew with every window, it would seem known
better and better. Several starts run beside one another until what follows tells which is true.
"""

import math
from collections.abc import Sequence
from copy import copy
from itertools import product
from typing import Self

import numpy as np

from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_observer.position.balance import (
    SMALLEST,
    ForceBalance,
    Known,
    Resting,
    balance_rows,
    moved,
)
from crane_observer.position.flow import MOST_BY_WEIGHT
from crane_observer.position.state import FlowWindow, Gaussian, Pair, PoseEstimate, StateLayout

BALANCE_OUTLYING = 2.5  # standard deviations, from which on a measurement counts less
SURPRISE = 5.0  # standard deviations of a load that comes or goes, in the sum over some windows
SURPRISE_SLACK = 0.75  # of these, a window, that are no surprise
SURPRISE_LIMIT = 2.5  # of these, a window, that count: a single window is no surprise
SURPRISE_BY_LOAD = 0.6  # of the surprise, what a load must explain of it
SET_ASIDE = 5.0  # standard deviations of each innovation, beyond which one is set aside
SET_ASIDE_IN_A_ROW = 3  # windows; what stays is no slip of a sensor

MEMORY = 30.0  # s, in which half of the information of the force balance is forgotten
OBSERVABLE_SHARE = 0.02  # of the range of a joint, one standard deviation of an observable one
POSES = 256  # that are looked at for what the weight tells

START_POINTS = 4  # of the range of each joint whose start is not known
START_MARGIN = 0.05  # of the range, from its ends to the first and last of them
TEMPERED = 0.1  # of a log likelihood counts: errors of the model are alike from window to window
HOPELESS = 10.0  # of a log likelihood below the best, where a start is given up
ALIKE_DEVIATIONS = 2.0  # within which two hypotheses are one


class Surprise:
    """Test whether innovations ask for another load: a two-sided CUSUM of their projection on it.

    The sums are replaced and never written to.
    """

    def __init__(self) -> None:
        self._sums = np.zeros(2)  # for more load, and for less
        self._aside = 0  # of the last innovations
        self.suspected = False  # the last innovations ask for another load, or are outliers

    def add(self, load: Array, innovation: Array, covariance: Array) -> bool:
        """Innovations (r,) with their covariance (r, r), and what 1 kg more asks of them (r,)."""
        spread = np.linalg.solve(covariance, np.stack([load, innovation], 1))
        information = float(load @ spread[:, 0])
        self.suspected = False
        if information <= 0.0:
            return False
        away = float(load @ spread[:, 1]) / math.sqrt(information)
        if away**2 < SURPRISE_BY_LOAD * float(innovation @ spread[:, 1]):
            away = 0.0  # something else
        change = np.clip(np.array([1.0, -1.0]) * away, -SURPRISE_LIMIT, SURPRISE_LIMIT)
        self._sums = np.maximum(self._sums + change - SURPRISE_SLACK, 0.0)
        if self._sums.max() < SURPRISE:
            far = float(innovation @ spread[:, 1]) > SET_ASIDE**2 * len(innovation)
            self._aside = self._aside + 1 if far else 0
            outlier = far and self._aside <= SET_ASIDE_IN_A_ROW
            self.suspected = abs(away) > SURPRISE_LIMIT or outlier
            return False
        self._sums = np.zeros(2)
        return True


class Filter:
    """The estimate of one start; see the equations above."""

    def __init__(self, known: Known, position: Array, deviation: Array, load: float = 0.0):
        """From `position` (j,), known to `deviation` (j,), with a load known to 1 kg."""
        self.known, self.start = known, position
        layout = known.layout
        x, spread = np.zeros(layout.size), known.spread
        x[layout.position], spread[layout.position] = position, deviation
        x[layout.load], spread[layout.load] = load, 1.0
        self.state = Gaussian(x, np.diag(spread**2), layout.load + 1)
        self.velocity = np.zeros(layout.joints)
        self._jitter = np.zeros(layout.joints)  # of a position, by noise of pressures
        self._doubt = np.zeros(layout.joints)  # of a velocity, by transducers that are off
        self._gathered: tuple[tuple[FlowWindow, Array], ...] = ()  # windows and their velocities
        self.likelihood = 0.0
        self.rows = np.zeros((0, layout.size))  # of the last force balance, of unit variance
        self._resting, self._surprise = Resting(known), Surprise()
        self._hidden_load = 0.0  # kg that may have come where all joints stand, by dry friction
        self._spread, self._stay = known.spread, known.stay

    @property
    def position(self) -> Array:
        """(j,) the coordinates."""
        return self.state.x[self.known.layout.position]

    def copied(self) -> Self:
        copied = copy(self)
        copied.state = self.state.copied()
        copied._resting, copied._surprise = copy(self._resting), copy(self._surprise)
        return copied

    def step(self, window: FlowWindow) -> PoseEstimate:
        layout, begun = self.known.layout, self.position.copy()
        self._drift(window)
        found = moved(self.known, self.state.x, self.position, window)
        self.state.move(found.displacement, found.slopes, found.noise)
        self._jitter = found.jitter
        seen = np.isfinite(window.encoders)
        if seen.any():
            self._read(window.encoders, seen)
        # against a stop, or a load that is too heavy, flow says what an encoder does not
        self.velocity = (self.position - begun) / window.duration
        self._doubt = np.where(seen, 0.0, found.doubt / window.duration)
        surprised = False
        self.rows = np.zeros((0, layout.size))
        self._gathered = (*self._gathered, (window, self.velocity)) if window.whole else ()
        steps, odd = divmod(len(self._gathered), 2)
        if not odd and steps and steps + 0.5 > self.known.balance_steps:
            surprised = self._correct_by_forces(Pair.of(self._gathered))
            self._gathered = ()
        self.position[:] = np.clip(self.position, self.known.low, self.known.high)
        covariance = self.state.P[np.ix_(layout.told, layout.told)]
        covariance[-1, -1] += self._hidden_load**2
        load = float(self.state.x[layout.load])
        return PoseEstimate(
            window.time, self.position.copy(), covariance, load, self.velocity, surprised
        )

    def _drift(self, window: FlowWindow) -> None:
        # the model error in a pose stays while no joint leaves it
        decay = np.exp(-(0.0 if self._resting.all_stand else window.duration) / self._stay)
        added = (1.0 - decay**2) * self._spread**2
        added[self.known.layout.load] = self.known.load_drift**2 * window.duration
        self.state.relax(decay, added)

    def _read(self, encoders: Array, seen: Flags) -> None:
        H = np.eye(self.known.layout.joints, self.known.layout.size)
        variance = np.where(seen, self.known.resolution**2, np.inf)
        innovation = np.where(seen, encoders - self.position, 0.0)
        self.likelihood += self.state.correct(H, innovation, variance)

    def _correct_by_forces(self, pair: Pair) -> bool:
        """Correct by the force balance between two windows; whether the load changed."""
        known, layout = self.known, self.known.layout
        motions = self._resting.judge(pair, self._doubt)
        pair = pair.without_motion(motions.held)
        q = self.position - pair.second.duration * pair.velocities[1]
        motion = q[np.newaxis], pair.velocity[np.newaxis], pair.acceleration[np.newaxis]
        balance = ForceBalance(*(values[0] for values in known.mechanics.balance(*motion)))
        asked = balance.smooth + self.state.x[layout.load] * balance.load
        self._resting.hold(self.state, asked, balance.dry, pair.steps)
        cylinders = known.mechanics.cylinders(q[np.newaxis])[0]
        found = balance_rows(known, self.state, balance, pair, motions, cylinders, self._jitter)
        if not len(found.innovation):
            return False
        spread = found.H @ self.state.P @ found.H.T + found.noise
        moves = motions.moves[~motions.stalls]
        self._hide(balance, found.H[moves, layout.load], spread[np.ix_(moves, moves)])
        surprised = self._surprise.add(found.H[:, layout.load], found.innovation, spread)
        if self._surprise.suspected:
            return False  # what follows tells
        if surprised:
            added = np.zeros(layout.size)
            added[layout.load] = (known.trust.load * known.trust.unknown) ** 2
            self.state.relax(np.ones(layout.size), added)
        H, innovation = found.white()
        away = np.abs(innovation) / np.sqrt(1.0 + np.einsum("ik,kl,il->i", H, self.state.P, H))
        variance = np.maximum(1.0, away / BALANCE_OUTLYING) ** 2  # Huber: an outlier counts less
        self.rows = H
        self.likelihood += self.state.correct(H, innovation, variance)
        return surprised

    def _hide(self, balance: ForceBalance, load: Array, covariance: Array) -> None:
        """Hide a load that dry friction may hold while all joints stand. It stays hidden until
        joints that move have shown as much: `load` (r,) asked by 1 kg of those, with the
        `covariance` (r, r) of their estimate.
        """
        if self._resting.all_stand:
            hiding = balance.dry / np.maximum(np.abs(balance.load), SMALLEST)
            self._hidden_load = max(self._hidden_load, float(hiding.min()))
        elif self._hidden_load and len(load):
            told = float(load @ np.linalg.solve(covariance, load))
            self._hidden_load = 1.0 / math.sqrt(1.0 / self._hidden_load**2 + told)


class Observability:
    """Which joints the force balance determines, whatever is believed of them.

    The information about all states, half of it forgotten in some time, with what is known of a
    model's errors and nothing of positions and load; a position is observable if this bounds it.
    """

    def __init__(self, layout: StateLayout, span: Array, spread: Array, unknown: float):
        """Joints have a `span` (j,), errors a `spread` (size,), `unknown` loads [kg] as well."""
        self._layout, self._span = layout, span
        known = spread.copy()
        known[layout.position], known[layout.load] = span, unknown
        self._prior = np.diag(1.0 / known**2)
        self._information = np.zeros((layout.size, layout.size))

    def add(self, rows: Array, duration: float) -> None:
        """Those of unit variance with slopes `rows` (r, size), `duration` [s] after the last."""
        self._information *= math.exp(-duration / MEMORY)
        self._information += rows.T @ rows

    @property
    def deviation(self) -> Array:
        """(j,) of each position, by the force balance alone."""
        covariance = np.linalg.inv(self._information + self._prior)
        return np.sqrt(np.diag(covariance)[self._layout.position])

    @property
    def observable(self) -> Flags:
        """(j,) whether the position of each joint is bounded by it."""
        return np.asarray(self.deviation < OBSERVABLE_SHARE * self._span)


def refuse_unserved(model: Model, hidden: Flags) -> list[str]:
    """Warnings about `hidden` joints (j,) served by weight alone; `ConfigurationError` if none."""
    known = Known.of(model, np.zeros(len(model.joints)))
    by_weight = hidden & known.assumed
    names = [joint for joint, served in zip(model.joints, by_weight, strict=True) if served]
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
    return np.asarray(told > 1.0 / (OBSERVABLE_SHARE * (known.high - known.low)) ** 2)


class Hypotheses:
    """Filters from several starts; a start that is known is one."""

    def __init__(self, known: Known, position: Array, deviation: Array):
        """`position` (j,) with NaN where it may be anywhere; `deviation` (j,) where it is known."""
        span = known.high - known.low
        steps = np.linspace(START_MARGIN, 1.0 - START_MARGIN, START_POINTS)
        choices: Sequence[Array] = [
            low + width * steps if np.isnan(at) else np.array([at])
            for at, low, width in zip(position, known.low, span, strict=True)
        ]
        spread = np.where(np.isnan(position), span / START_POINTS, deviation)
        self.filters = [Filter(known, np.array(start), spread) for start in product(*choices)]

    @property
    def scores(self) -> Array:
        """(h,) of the filters, logs."""
        return TEMPERED * np.array([hypothesis.likelihood for hypothesis in self.filters])

    def copied(self) -> Self:
        copied = copy(self)
        copied.filters = [hypothesis.copied() for hypothesis in self.filters]
        return copied

    def step(self, window: FlowWindow) -> PoseEstimate:
        """After one more window: that of the likeliest, wider by what the others say."""
        estimates = [hypothesis.step(window) for hypothesis in self.filters]
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
    away = [np.append(e.position - best.position, e.load - best.load) for e in estimates]
    apart = sum(w * np.outer(distance, distance) for w, distance in zip(weights, away, strict=True))
    return best._replace(covariance=best.covariance + apart)


def _alike(first: PoseEstimate, second: PoseEstimate) -> bool:
    spread = np.sqrt(np.diag(first.covariance)[:-1] + np.diag(second.covariance)[:-1])
    return bool((np.abs(first.position - second.position) < ALIKE_DEVIATIONS * spread).all())
