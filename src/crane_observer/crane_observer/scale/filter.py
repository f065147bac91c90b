"""The load and what the model is wrong about, from one window after another.

    tau = tau_0 + (m + t) h_m + s h_s + d D + e V + c C + B (z + b) + P p

with the balance of `crane_observer.scale.balance`; t is what was tared, z and b are errors of the
pistons' forces that stay and that come and go, as of pressures B in the chambers A; D is dry
friction in the direction of motion and V viscous friction, d and e how wrong they are; C is what a
joint carries, the load too, in the direction of motion: by c of it dry friction grows, which (13)
does not know; p is how wrong positions that are estimated are, in their standard deviations, by
each of which the balance is wrong by P. A joint that stands has its dry friction anywhere between
both directions, and elsewhere in each window.
"""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.position.kalman import correct, relax
from crane_observer.scale.balance import TipBalance
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.kinds import CARRIED, DRY, KINDS, PLACE, SLOW, STICK, VISCOUS, ZERO

MASS, MOMENT, TARE = range(3)
HEAVY = 100.0  # kg, standard deviation of a load of which nothing is known
FAR = 0.5  # m beyond the tip, of the centre of one
TAKEN = 0.05  # kg, kg m: how well a tare is zero
OUTLYING = 3.0  # standard deviations, from which on a measurement counts less


class Balanced(NamedTuple):
    """A window as the filter takes it."""

    duration: float  # s since the last one
    balance: TipBalance
    moving: Flags  # (j,) in one direction throughout
    standing: Flags  # (j,) throughout; a joint that is neither starts, stops or turns
    upwards: Flags  # (j,) the direction in which it moves
    by_place: Array  # (j, j) force for a standard deviation of each position; 0 of measured ones


class LoadFilter:
    """State of `3 + KINDS j` numbers; see the equation above."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.doubt, self.joints = doubt, joints
        size = 3 + KINDS * joints
        self.x, spread, self._stay = np.zeros(size), np.zeros(size), np.full(size, np.inf)
        spread[TARE] = doubt.tool
        for kind, (deviation, stays) in doubt.kinds.items():
            spread[self.of(kind)], self._stay[self.of(kind)] = deviation, stays
        self.prior = spread.copy()
        spread[MASS], spread[MOMENT] = HEAVY, HEAVY * FAR
        self.P = np.diag(spread**2)
        self._stood = np.zeros(joints, dtype=bool)

    def of(self, kind: int) -> slice:
        """The states of a kind, by joint."""
        return slice(3 + kind * self.joints, 3 + (kind + 1) * self.joints)

    def copy(self) -> "LoadFilter":
        """As it is now."""
        other = LoadFilter(self.doubt, self.joints)
        other.x, other.P, other._stood = self.x.copy(), self.P.copy(), self._stood.copy()
        return other

    def another_load(self) -> None:
        """A load came or went: nothing is known of it, nor of friction where a joint stands."""
        self._forget([MASS, MOMENT], np.array([HEAVY, HEAVY * FAR]))
        self._forget(
            range(*self.of(STICK).indices(len(self.x))), np.full(self.joints, self.doubt.held)
        )

    def tare(self) -> None:
        """What hangs at the tip counts as nothing from now on."""
        if abs(self.x[MASS]) < 3.0 * np.sqrt(self.P[MASS, MASS]):  # it was nothing
            H = np.eye(2, len(self.x))
            correct(self.x, self.P, H, -self.x[:2], np.full(2, TAKEN**2), len(self.x))
            return
        move = np.eye(len(self.x))
        move[TARE, MASS] = 1.0
        move[MASS], move[MOMENT] = 0.0, 0.0
        self.x, self.P = move @ self.x, move @ self.P @ move.T
        self.P[[MASS, MOMENT], [MASS, MOMENT]] += TAKEN**2

    def drift(self, duration: float) -> None:
        """Some time [s] goes by."""
        decay = np.exp(-duration / self._stay)
        added = (1.0 - decay**2) * self.prior**2
        added[MASS] += self.doubt.drift**2 * duration
        relax(self.x, self.P, decay, added)

    def innovation(self, window: Balanced) -> tuple[Array, Array, Array]:
        """Slopes (r, size), innovations and variances (r,) of the joints that tell something."""
        one, doubt, rows = window.balance, self.doubt, np.arange(self.joints)
        dry = np.where(window.upwards, one.up, one.down)
        middle, range_ = 0.5 * (one.up + one.down), 0.5 * np.abs(one.up - one.down)
        H = np.zeros((self.joints, len(self.x)))
        H[:, MASS], H[:, MOMENT], H[:, TARE] = one.mass, one.moment, one.mass
        H[:, self.of(ZERO)] = H[:, self.of(SLOW)] = one.by_pressure
        H[rows, self.of(DRY).start + rows] = np.where(window.moving, dry, 0.0)
        H[rows, self.of(VISCOUS).start + rows] = one.viscous
        H[rows, self.of(STICK).start + rows] = np.where(window.standing, range_, 0.0)
        H[:, self.of(PLACE)] = window.by_place
        carried = one.asked - one.viscous - one.inertial + self.x[MASS] * one.mass
        by_load = np.where(window.moving, np.sign(dry * carried), 0.0)
        H[rows, self.of(CARRIED).start + rows] = by_load * carried
        known = one.asked + np.where(window.moving, dry, middle)
        own = np.abs(one.by_pressure).sum(axis=1)
        variance = own**2 * (doubt.noise**2 + doubt.sensors**2)
        variance += (doubt.inertia * one.inertial) ** 2
        variance += np.where(window.moving, 0.0, range_**2) * np.where(
            window.standing, doubt.creep**2, 1.0
        )
        innovation = one.force - known - H @ self.x
        H[:, MASS] += self.x[self.of(CARRIED)] * by_load * one.mass
        told = np.isfinite(innovation + variance)
        return H[told], innovation[told], variance[told]

    def begin(self, window: Balanced) -> None:
        """Time goes by, and joints that come to stand hold by friction of their own."""
        self.drift(window.duration)
        stopped = np.flatnonzero(window.standing & ~self._stood)
        self._forget(self.of(STICK).start + stopped, np.full(len(stopped), self.doubt.held))
        self._stood = window.standing.copy()

    def correct(self, H: Array, innovation: Array, variance: Array) -> None:
        """By what `innovation` gave."""
        away = np.abs(innovation) / np.sqrt(variance + np.einsum("ik,kl,il->i", H, self.P, H))
        variance = variance * np.maximum(1.0, away / OUTLYING) ** 2
        correct(self.x, self.P, H, innovation, variance, len(self.x))
        self.x[self.of(STICK)] = np.clip(self.x[self.of(STICK)], -1.0, 1.0)

    def _forget(self, places: object, deviations: Array) -> None:
        """Nothing is known of these states any more but that they are about zero."""
        at = np.array(places, dtype=int)
        self.P[at], self.P[:, at], self.x[at] = 0.0, 0.0, 0.0
        self.P[at, at] = deviations**2
