"""The load and what the model is wrong about, from one window after another, compiled.

    tau = tau_0 + (m + t) h_m + s h_s + (d + g k) D + e V + c C + B (z + b) + P p

with the balance of `crane_observer.scale.balance`; t is what was tared, z and b are errors of the
pistons' forces that stay and that come and go, as of pressures B in the chambers A; D is dry
friction in the direction of motion and V viscous friction, d and e how wrong they are; g, 0 to 1,
is how near a joint is to stopping, where dry friction is another, as in breakaway, by k of it; C is
what a joint carries, the load too, in the direction of motion: by c of it dry friction grows, which
(13) does not know; p is how wrong positions that are estimated are, in their standard deviations,
by each of which the balance is wrong by P. A joint that does not move steadily has its dry friction
anywhere between both directions, and elsewhere in each window, but in all that follow about there:
what it hides does not become known by counting it again.
"""

import math
from copy import copy
from typing import NamedTuple, Self

import numpy as np
from numba import njit

from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_observer.position.kalman import correct, relax
from crane_observer.position.state import Trust
from crane_observer.scale.balance import TipBalance

# The kinds of states that each joint has in a `LoadFilter`.

ZERO, SLOW, DRY, VISCOUS, STICK, CARRIED, PLACE, CRAWL = range(8)
KINDS = 8


# How far an identified model is trusted when something is weighed with it.

SHARPER = 4.0 / 3.0  # power of the position sensor's share: no flow is used here


class ModelDoubt(NamedTuple):
    """Standard deviations, and for how long errors stay; of a model that deserves little trust."""

    zero: float = 0.3e5  # Pa, of the piston's force, for as long as anybody weighs
    slow: float = 0.15e5  # Pa, the same, for a while
    slow_stays: float = 8.0  # s
    dry: float = 0.05  # of dry friction
    viscous: float = 0.05  # of viscous friction
    friction_stays: float = 300.0  # s
    carried: float = 0.03  # of the force that a joint carries, by which friction grows
    crawl: float = 0.25  # of dry friction, by which breakaway exceeds it: (13) has none
    crawl_stays: float = 8.0  # s
    held: float = 1.0  # of dry friction where a joint stands: anywhere
    creep: float = 1.0  # of it, by which it may be elsewhere in each window
    slip_stays: float = 1.0  # s, of friction where a joint sticks and slips
    place_stays: float = 60.0  # s, of errors of an estimated position
    noise: float = 0.2e5  # Pa, of a window, of the piston's force
    sensors: float = 2.3e3  # Pa, the same, by noise of the readings
    inertia: float = 0.1  # of the force that accelerates: encoders tell acceleration badly
    tool: float = 0.5  # kg, of what the model has at the tip
    drift: float = 0.05  # kg/sqrt(s), of a load that nobody changes

    @classmethod
    def of(cls, model: Model) -> "ModelDoubt":
        """As far as the model deserves it, as the position sensor judges it."""
        share = (Trust.of(model).dry / Trust().dry) ** SHARPER
        blamed = ("zero", "slow", "dry", "viscous", "carried", "crawl", "noise", "tool", "drift")
        full = cls()
        return full._replace(**{name: share * getattr(full, name) for name in blamed})

    @property
    def kinds(self) -> dict[int, tuple[float, float]]:
        """Of each kind of state of a joint: standard deviation, and how long it stays [s]."""
        return {
            ZERO: (self.zero, math.inf),
            SLOW: (self.slow, self.slow_stays),
            DRY: (self.dry, self.friction_stays),
            VISCOUS: (self.viscous, self.friction_stays),
            STICK: (self.held, math.inf),
            CARRIED: (self.carried, math.inf),
            PLACE: (1.0, self.place_stays),
            CRAWL: (self.crawl, self.crawl_stays),
        }


MASS, MOMENT, TARE = range(3)
HEAVY = 100.0  # kg, standard deviation of a load of which nothing is known
FAR = 0.5  # m beyond the tip, of the centre of one
TAKEN = 0.05  # kg, kg m: how well a tare is zero
OUTLYING = 3.0  # standard deviations, from which on a measurement counts less
TAIL = 4.0  # degrees of freedom of Student's t: a window that nothing explains decides little


class Balanced(NamedTuple):
    """A window as the filter takes it."""

    duration: float  # s since the last one
    balance: TipBalance
    moving: Flags  # (j,) in one direction throughout
    standing: Flags  # (j,) throughout; a joint that is neither starts, stops or turns
    upwards: Flags  # (j,) the direction in which it moves
    crawling: Array  # (j,) how near to stopping, 0 to 1
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
        self._held = np.zeros(joints, dtype=bool)

    def of(self, kind: int) -> slice:
        """The states of a kind, by joint."""
        return slice(3 + kind * self.joints, 3 + (kind + 1) * self.joints)

    def copy(self) -> Self:
        """As it is now."""
        other = copy(self)
        other.x, other.P, other._held = self.x.copy(), self.P.copy(), self._held.copy()
        return other

    def another_load(self) -> None:
        """A load came or went: nothing is known of it, nor of friction where a joint stands."""
        _forget(self.x, self.P, MASS, HEAVY)
        _forget(self.x, self.P, MOMENT, HEAVY * FAR)
        for place in range(*self.of(STICK).indices(len(self.x))):
            _forget(self.x, self.P, place, self.doubt.held)

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

    def innovation(self, window: Balanced) -> tuple[Array, Array, Array]:
        """Slopes (r, size), innovations and variances (r,) of the joints that tell something."""
        return innovation(self.x, window, self.doubt)

    def begin(self, window: Balanced) -> None:
        """Time goes by, and joints that stop are held by friction of their own."""
        begin(self.x, self.P, self.prior, self._stay, self._held, window, self.doubt)

    def take(self, window: Balanced) -> float:
        """All that a window tells; how likely it was (logarithm, but for a constant)."""
        self.begin(window)
        return take(self.x, self.P, window, self.doubt)


@njit(cache=True, error_model="numpy")
def begin(
    x: Array, P: Array, prior: Array, stay: Array, held: Flags, window: Balanced, doubt: ModelDoubt
) -> None:
    """In place; `held` (j,) joints that did not move steadily before. See `LoadFilter.begin`."""
    decay, joints = np.exp(-window.duration / stay), len(held)
    for j in range(joints):
        if not window.moving[j] and not window.standing[j]:
            decay[3 + STICK * joints + j] = np.exp(-window.duration / doubt.slip_stays)
    added = (1.0 - decay**2) * prior**2
    added[MASS] += doubt.drift**2 * window.duration
    relax(x, P, decay, added)
    for j in range(joints):
        if not window.moving[j] and not held[j]:
            _forget(x, P, 3 + STICK * joints + j, doubt.held)
        held[j] = not window.moving[j]


@njit(cache=True, error_model="numpy")
def innovation(x: Array, window: Balanced, doubt: ModelDoubt) -> tuple[Array, Array, Array]:
    """Slopes (r, size), innovations and variances (r,) of the joints that tell something, with
    the state x (size,).
    """
    one, joints = window.balance, len(window.moving)
    H, innovation = np.zeros((joints, len(x))), np.zeros(joints)
    variance, told = np.zeros(joints), np.zeros(joints, dtype=np.bool_)
    for j in range(joints):
        moving = window.moving[j]
        dry = one.up[j] if window.upwards[j] else one.down[j]
        middle, range_ = 0.5 * (one.up[j] + one.down[j]), 0.5 * abs(one.up[j] - one.down[j])
        H[j, MASS], H[j, MOMENT], H[j, TARE] = one.mass[j], one.moment[j], one.mass[j]
        own = 0.0
        for k in range(joints):
            H[j, 3 + ZERO * joints + k] = one.by_pressure[j, k]
            H[j, 3 + SLOW * joints + k] = one.by_pressure[j, k]
            H[j, 3 + PLACE * joints + k] = window.by_place[j, k]
            own += abs(one.by_pressure[j, k])
        H[j, 3 + VISCOUS * joints + j] = one.viscous[j]
        variance[j] = own**2 * (doubt.noise**2 + doubt.sensors**2)
        variance[j] += (doubt.inertia * one.inertial[j]) ** 2
        by_load = 0.0
        if moving:
            carried = one.asked[j] - one.viscous[j] - one.inertial[j] + x[MASS] * one.mass[j]
            by_load = np.sign(dry * carried)
            H[j, 3 + DRY * joints + j] = dry
            H[j, 3 + CRAWL * joints + j] = dry * window.crawling[j]
            H[j, 3 + CARRIED * joints + j] = by_load * carried
        else:
            H[j, 3 + STICK * joints + j] = range_
            variance[j] += (range_ * doubt.creep) ** 2
        known = one.asked[j] + (dry if moving else middle)
        innovation[j] = one.force[j] - known - H[j] @ x
        H[j, MASS] += x[3 + CARRIED * joints + j] * by_load * one.mass[j]
        told[j] = np.isfinite(innovation[j] + variance[j])
    return H[told], innovation[told], variance[told]


@njit(cache=True, error_model="numpy")
def take(x: Array, P: Array, window: Balanced, doubt: ModelDoubt) -> float:
    """In place, when the window has begun. See `LoadFilter.take`."""
    H, away, variance = innovation(x, window, doubt)
    spread = H @ P @ H.T + np.diag(variance)
    squared = away @ np.linalg.solve(spread, away)
    likelihood = -0.5 * (TAIL + len(away)) * math.log1p(squared / TAIL)
    likelihood -= 0.5 * np.linalg.slogdet(spread)[1]
    far = np.abs(away) / np.sqrt(np.diag(spread))
    variance = variance * np.maximum(1.0, far / OUTLYING) ** 2
    correct(x, P, H, away, variance, len(x))
    joints = len(window.moving)
    for place in range(3 + STICK * joints, 3 + (STICK + 1) * joints):
        x[place] = min(max(x[place], -1.0), 1.0)
    return likelihood


@njit(cache=True, error_model="numpy")
def _forget(x: Array, P: Array, place: int, deviation: float) -> None:
    """Nothing is known of a state any more but that it is about zero."""
    P[place], P[:, place], x[place] = 0.0, 0.0, 0.0
    P[place, place] = deviation**2
