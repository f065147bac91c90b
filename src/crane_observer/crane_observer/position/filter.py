"""One window after another: strokes from flow, corrected by encoders and by the force balance.

    x_i(q+) = x_i(q) + (1 + g_i) s_i + n_i N_i                                       prediction
    L_i F_i = tau_i(q, q', q'') + m h_i(q, q', q'') + c_i d_i + v_i f_i + L_i A_i b_i    balance

with length x_i and lever arm L_i of cylinder i (20), (24), the stroke s_i that its flow makes and
N_i what a null does to it, piston force F_i (19), the model tau_i (16) with dry and viscous
friction d_i and f_i, and h_i for a load of 1 kg. Where a joint stands, dry friction may be anything
between its branches, and stays what it is: counted anew with every window, it would seem known
better and better.
"""

import math
from copy import copy
from typing import Self

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.position.balance import SMALLEST, ForceBalance, Known
from crane_observer.position.kalman import Gaussian
from crane_observer.position.state import POSITION, FlowWindow, PoseEstimate
from crane_observer.position.strokes import Resting, moved
from crane_observer.position.weighing import Pair, weigh

# Whether innovations ask for another load: two-sided CUSUM of their projection on it.

SURPRISE = 5.0  # standard deviations of a load that comes or goes, in the sum over some windows
SLACK = 0.75  # of these, a window, that are no surprise
MOST = 2.5  # of these, a window, that count: one alone is no surprise
EXPLAINED = 0.6  # of the surprise, what a load must explain of it
FAR = 5.0  # standard deviations of each innovation, beyond which one is set aside
ASIDE = 3  # in a row; what stays is no slip of a sensor


class Surprise:
    """The sums of one filter, for more load and for less; replaced and never written to."""

    def __init__(self) -> None:
        self._sums = np.zeros(2)
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
        if away**2 < EXPLAINED * float(innovation @ spread[:, 1]):
            away = 0.0  # something else
        signs = np.array([1.0, -1.0])
        self._sums = np.maximum(self._sums + np.clip(signs * away, -MOST, MOST) - SLACK, 0.0)
        if self._sums.max() < SURPRISE:
            far = float(innovation @ spread[:, 1]) > FAR**2 * len(innovation)
            self._aside = self._aside + 1 if far else 0
            self.suspected = abs(away) > MOST or (far and self._aside <= ASIDE)
            return False
        self._sums = np.zeros(2)
        return True


OUTLYING = 2.5  # standard deviations, from which on a measurement counts less


class Filter:
    """The estimate of one start; see the equations above."""

    def __init__(self, known: Known, position: Array, deviation: Array, load: float = 0.0):
        """From `position` (j,), known to `deviation` (j,), with a load known to 1 kg."""
        self.known, self.start = known, position
        layout = known.layout
        x, spread = np.zeros(layout.size), known.spread
        x[layout.of(POSITION)], spread[layout.of(POSITION)] = position, deviation
        x[layout.load], spread[layout.load] = load, 1.0
        self.state = Gaussian(x, np.diag(spread**2), layout.load + 1)
        self.velocity = np.zeros(layout.joints)
        self._jitter = np.zeros(layout.joints)  # of a position, by noise of pressures
        self._doubt = np.zeros(layout.joints)  # of a velocity, by transducers that are off
        self._first: tuple[FlowWindow, Array] | None = None
        self.likelihood = 0.0
        self.rows = np.zeros((0, layout.size))  # of the last force balance, of unit variance
        self._resting, self._surprise = Resting(known), Surprise()
        self._hidden_load = 0.0  # kg that may have come where all joints stand, by dry friction
        self._spread, self._stay = known.spread, known.stay

    @property
    def position(self) -> Array:
        """(j,) the coordinates."""
        return self.state.x[self.known.layout.of(POSITION)]

    def copied(self) -> Self:
        """As it stands, to go back to."""
        other = copy(self)
        other.state = self.state.copied()
        other._resting, other._surprise = copy(self._resting), copy(self._surprise)
        return other

    def step(self, window: FlowWindow) -> PoseEstimate:
        """After one more window."""
        begun = self.position.copy()
        self._drift(window)
        self._move(window)
        seen = np.isfinite(window.encoders)
        if seen.any():
            self._read(window.encoders, seen)
        # against a stop, or a load that is too heavy, flow says what an encoder does not
        self.velocity = (self.position - begun) / window.duration
        self._doubt = np.where(seen, 0.0, self._doubt / window.duration)
        surprised = False
        self.rows = np.zeros((0, self.known.layout.size))
        if not window.whole:
            self._first = None
        elif self._first is None:
            self._first = window, self.velocity
        else:
            first, before = self._first
            surprised = self._weigh(Pair(first, window, np.stack([before, self.velocity])))
            self._first = None
        self.position[:] = np.clip(self.position, self.known.low, self.known.high)
        layout = self.known.layout
        covariance = self.state.P[np.ix_(layout.told, layout.told)]
        covariance[-1, -1] += self._hidden_load**2
        return PoseEstimate(
            window.time,
            self.position.copy(),
            covariance,
            float(self.state.x[layout.load]),
            self.velocity,
            surprised,
        )

    def _drift(self, window: FlowWindow) -> None:
        # what the model lacks in a pose stays while no joint leaves it
        decay = np.exp(-(0.0 if self._resting.all_stand else window.duration) / self._stay)
        added = (1.0 - decay**2) * self._spread**2
        added[self.known.layout.load] = self.known.load_drift**2 * window.duration
        self.state.relax(decay, added)

    def _move(self, window: FlowWindow) -> None:
        found = moved(self.known, self.state.x, self.position, window)
        self.state.move(found.way, found.slopes, found.noise)
        self._jitter, self._doubt = found.jitter, found.doubt

    def _read(self, encoders: Array, seen: Flags) -> None:
        layout = self.known.layout
        H = np.eye(layout.joints, layout.size)
        variance = np.where(seen, self.known.resolution**2, np.inf)
        innovation = np.where(seen, encoders - self.position, 0.0)
        self.likelihood += self.state.correct(H, innovation, variance)

    def _weigh(self, pair: Pair) -> bool:
        """Correct by the force balance between two windows; whether the load changed."""
        known, layout = self.known, self.known.layout
        before, after = pair.velocities
        motions = self._resting.judge(before, after, self._doubt, pair.opened)
        pair = pair.without_motion(motions.held)
        q = self.position - 0.5 * pair.duration * pair.velocity
        motion = q[np.newaxis], pair.velocity[np.newaxis], pair.acceleration[np.newaxis]
        one = ForceBalance(*(values[0] for values in known.mechanics.balance(*motion)))
        asked = one.smooth + self.state.x[layout.load] * one.load
        self._resting.hold(self.state, asked, one.dry)
        cylinders = known.mechanics.cylinders(q[np.newaxis])[0]
        found = weigh(known, self.state, one, pair, motions, cylinders, self._jitter)
        if not len(found.innovation):
            return False
        spread = found.H @ self.state.P @ found.H.T + found.noise
        moves = motions.moves[~motions.stalls]
        self._hide(one, found.H[moves, layout.load], spread[np.ix_(moves, moves)])
        surprised = self._surprise.add(found.H[:, layout.load], found.innovation, spread)
        if self._surprise.suspected:
            return False  # what follows tells
        if surprised:
            added = np.zeros(layout.size)
            added[layout.load] = known.trust.load**2
            self.state.relax(np.ones(layout.size), added)
        H, innovation = found.white()
        away = np.abs(innovation) / np.sqrt(1.0 + np.einsum("ik,kl,il->i", H, self.state.P, H))
        variance = np.maximum(1.0, away / OUTLYING) ** 2  # Huber: an outlier counts less
        self.rows = H
        self.likelihood += self.state.correct(H, innovation, variance)
        return surprised

    def _hide(self, one: ForceBalance, load: Array, covariance: Array) -> None:
        """Where all joints stand, a load may come that dry friction holds. It stays hidden until
        joints that move have told as much: `load` (r,) asked by 1 kg of those, with the
        `covariance` (r, r) of what they say.
        """
        if self._resting.all_stand:
            hiding = one.dry / np.maximum(np.abs(one.load), SMALLEST)
            self._hidden_load = max(self._hidden_load, float(hiding.min()))
        elif self._hidden_load and len(load):
            told = float(load @ np.linalg.solve(covariance, load))
            self._hidden_load = 1.0 / math.sqrt(1.0 / self._hidden_load**2 + told)
