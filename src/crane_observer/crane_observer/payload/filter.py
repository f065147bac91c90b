"""The load and the errors of the model, from one window after another, in compiled code.

    tau = tau_0 + (m + t) h_m + s h_s + (d + g k) D + e V + c C + B (z + b) + P p

tau_0(q, q', q'') is the model (16), h_m what 1 kg at the tip asks, and h_s what 1 kg m about the
tip does: a load m whose centre lies c beyond the tip, along the line from the last joint, has
s = m c; t is what was tared, z and b are errors of the pistons' forces that stay and that come and
go, as of pressures B in the chambers A; D is dry friction in the direction of motion and V viscous
friction, d and e how wrong they are; g, 0 to 1, is how near a joint is to stopping, where dry
friction is another, as in breakaway, by k of it; C is what a joint carries, the load too, in the
direction of motion: by c of it dry friction grows, which (13) does not know; p is how wrong
positions that are estimated are, in their standard deviations, by each of which the balance is
wrong by P. A joint that does not move steadily has its dry friction anywhere between both
directions, and elsewhere in each window, but in all that follow about there: what it hides does not
become known by counting it again.
"""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Self

import numpy as np
from numba import njit

from crane_model.array import Array, Flags
from crane_model.chain.dynamics import gravity_forces, inverse_dynamics, tip_bodies
from crane_model.cylinders import ChamberForces
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_observer.position.state import NUDGE, UNKNOWN_LOAD, Trust, correct, relax

SLOWER = 1e-2  # share of the velocity, for what grows with it
SHARE_POWER = 4.0 / 3.0  # of the position estimator's share: no flow is used here

ESTIMATED_VELOCITY = 0.1  # of a velocity that no encoder measures, how wrong it may be
ESTIMATED_ACCELERATION = 1.0  # the same of an acceleration

TOOL_SHARE = 5e-3  # of `ModelDoubt.unknown`
FAR = 0.5  # m beyond the tip, of the centre of such a load
TARED = 0.05  # kg, kg m: how well a tare is zero
WINDOW_OUTLYING = 3.0  # standard deviations, from which on a measurement counts less
TAIL = 4.0  # degrees of freedom of Student's t: a window that nothing explains decides little

CENTRED = 0.01  # m, standard deviation of the centre of a load that hangs at the tip
ELSEWHERE = 5.0  # standard deviations, from which on it does not hang there: accelerations are told
# badly, and by the same errors in window after window
KNOWN_CENTRE = 0.1  # m, standard deviation up to which motion has told the centre


class MeanMotion(NamedTuple):
    """Means over a window of j joints, weighted as in `crane_observer.payload.estimator`."""

    position: Array  # (j,) rad, m
    velocity: Array  # (j,)
    acceleration: Array  # (j,)
    chamber_a: Array  # (j,) Pa; NaN where nothing was measured
    chamber_b: Array  # (j,)


class TipBalance(NamedTuple):
    """The balance about one motion of j joints [N m, N]; see the equation above."""

    force: Array  # (j,) of the drives, by pressures
    asked: Array  # (j,) tau_0, without dry friction
    up: Array  # (j,) dry friction where the joint moves in its positive direction
    down: Array  # (j,) where it moves in the other
    viscous: Array  # (j,) the part that grows with the velocity
    inertial: Array  # (j,) the part that accelerates
    inertia: Array  # (j, j) for 1 rad/s2, 1 m/s2 more of each joint
    inertia_of_load: Array  # (2, j, j) the same, of 1 kg at the tip, and of 1 kg m about it
    mass: Array  # (j,) h_m [N m/kg, N/kg]
    moment: Array  # (j,) h_s [1/kg m of these]
    by_pressure: Array  # (j, j) for 1 Pa more in chamber A of each cylinder


@dataclass(frozen=True)
class TipMechanics:
    """A model with values, and bodies of 1 kg and of 1 kg m at the tip of its machine."""

    model: Model
    machine: Machine
    columns: Array  # (j,) where the joints of the model stand among those of the machine
    bodies: Array  # (2, m, 10) as `crane_model.chain` has bodies
    drives: ChamberForces

    @classmethod
    def of(cls, model: Model) -> "TipMechanics":
        """`ConfigurationError` names what the model lacks."""
        machine = model.machine
        if machine is None:
            raise ConfigurationError(
                f"model '{model.name}': no machine in it, which says where the tip is; identify it "
                "with the machine's file"
            )
        _ = model.theta  # or the error that names the remedy
        without = [joint for joint in model.joints if joint not in machine.cylinders]
        if without:
            raise ConfigurationError(
                f"model '{model.name}': {', '.join(without)} without chambers; a load is estimated "
                "by the pressures of hydraulic actuators"
            )
        columns = np.array([machine.index(joint) for joint in model.joints])
        drives = ChamberForces(machine, model.joints)
        return cls(model, machine, columns, tip_bodies(machine.chain), drives)

    def balance(self, motion: MeanMotion) -> TipBalance:
        """`RangeError` where a linkage cannot be assembled."""
        j = len(self.model.joints)
        q, v, a, p_a, p_b = motion
        known = np.isfinite(p_a) & np.isfinite(p_b)
        p_a, p_b = np.where(known, p_a, 0.0), np.where(known, p_b, 0.0)
        force = self.drives(q, np.concatenate([p_a, p_b]))
        by_pressure = np.stack([self.drives(q, row) for row in np.eye(2 * j)[:j]], axis=1)
        lost = (by_pressure[:, ~known] != 0.0).any(axis=1)
        asked, slower, resting, up, down, *by_joint = self._model_forces(motion, force, p_a, p_b)
        carried = np.stack([self._carried(body, q, v, a) for body in self.bodies])
        return TipBalance(
            force=np.where(lost, np.nan, force),
            asked=asked,
            up=up - asked,
            down=down - asked,
            viscous=(asked - slower) / SLOWER,
            inertial=asked - resting,
            inertia=(np.array(by_joint) - resting).T,
            inertia_of_load=np.stack([self._inertia_of_load(body, q) for body in self.bodies]),
            mass=carried[0],
            moment=carried[1],
            by_pressure=by_pressure,
        )

    def weights(self, positions: Array) -> Array:
        """(n, j) what 1 kg at the tip asks at rest in positions (n, j)."""
        whole = np.zeros((len(positions), len(self.machine.joint_names)))
        whole[:, self.columns] = positions
        return gravity_forces(self.machine.chain, self.bodies[0], whole)[:, self.columns]

    def slopes(self, motion: MeanMotion, load: float) -> Array:
        """(j, j) of force less what is asked with a load [kg], row by joint, against positions."""

        def miss(q: Array) -> Array:
            balance = self.balance(motion._replace(position=q))
            return balance.force - balance.asked - load * balance.mass

        here, q = miss(motion.position), motion.position
        steps = NUDGE * np.eye(len(q))
        return np.stack([(miss(q + step) - here) / NUDGE for step in steps], axis=1)

    def _model_forces(self, motion: MeanMotion, force: Array, p_a: Array, p_b: Array) -> Array:
        """(5 + j, j): without dry friction; the same slower; without acceleration; moving up; down;
        accelerated by 1 in one joint after the other.
        """
        j = len(self.model.joints)
        cases = np.ones((5 + j, 1))
        velocity = cases * motion.velocity
        velocity[1] *= 1.0 - SLOWER
        acceleration = cases * motion.acceleration
        acceleration[2], acceleration[5:] = 0.0, np.eye(j)
        direction = np.zeros_like(velocity)
        direction[3], direction[4] = 1.0, -1.0
        rows = np.arange(5.0 + j)
        record = Record(
            joints=self.model.joints,
            time=rows,
            position=cases * motion.position,
            velocity=velocity,
            acceleration=acceleration,
            run=rows,  # nothing is remembered from one row to the next
            force=cases * force,
            pressure_a=cases * p_a,
            pressure_b=cases * p_b,
            direction_known=direction,
        )
        return self.model.predict(record)

    def _inertia_of_load(self, body: Array, q: Array) -> Array:
        """(j, j) what the body asks of each joint for 1 rad/s2, 1 m/s2 of each."""
        rows = len(self.columns) + 1
        whole = np.zeros((3, rows, len(self.machine.joint_names)))
        whole[0][:, self.columns] = q
        whole[2][1:, self.columns] = np.eye(rows - 1)
        found = inverse_dynamics(self.machine.chain, body, *whole)[:, self.columns]
        inertia: Array = (found[1:] - found[0]).T
        return inertia

    def _carried(self, body: Array, q: Array, v: Array, a: Array) -> Array:
        """(j,) what the body asks, the other joints of the machine at rest."""
        whole = np.zeros((3, 1, len(self.machine.joint_names)))
        whole[:, 0, self.columns] = q, v, a
        return inverse_dynamics(self.machine.chain, body, *whole)[0, self.columns]


MASS, MOMENT, TARE, KINDS_FROM = range(4)  # places of the states; then those of each kind by joint


class LoadState(IntEnum):
    """The kinds of states that each joint has in a `LoadFilter`."""

    ZERO = 0
    SLOW = 1
    DRY = 2
    VISCOUS = 3
    STICK = 4
    CARRIED = 5
    PLACE = 6
    CRAWL = 7


class ModelDoubt(NamedTuple):
    """How far an identified model is trusted when a load is estimated with it: standard deviations,
    and for how long errors stay; of a model that deserves little trust.
    """

    zero: float = 0.3e5  # Pa, of the piston's force, for as long as loads are estimated
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
    inertia: float = 0.1  # of the force that accelerates: encoders tell acceleration badly
    unknown: float = UNKNOWN_LOAD  # kg
    tool: float = 0.5  # kg, of what the model has at the tip
    drift: float = 0.05  # kg/sqrt(s), of a load that nobody changes

    @classmethod
    def of(cls, model: Model) -> "ModelDoubt":
        """As far as the model deserves it, as the position estimator judges it; a load as its
        machine can hold it.
        """
        trust = Trust.of(model)
        share, unknown = (trust.dry / Trust().dry) ** SHARE_POWER, trust.unknown
        blamed = ("zero", "slow", "dry", "viscous", "carried", "crawl", "noise", "tool", "drift")
        full = cls(unknown=unknown, tool=TOOL_SHARE * unknown, drift=trust.load_drift * unknown)
        return full._replace(**{name: share * getattr(full, name) for name in blamed})

    @property
    def kinds(self) -> dict[LoadState, tuple[float, float]]:
        """Of each kind of state of a joint: standard deviation, and how long it stays [s]."""
        return {
            LoadState.ZERO: (self.zero, math.inf),
            LoadState.SLOW: (self.slow, self.slow_stays),
            LoadState.DRY: (self.dry, self.friction_stays),
            LoadState.VISCOUS: (self.viscous, self.friction_stays),
            LoadState.STICK: (self.held, math.inf),
            LoadState.CARRIED: (self.carried, math.inf),
            LoadState.PLACE: (1.0, self.place_stays),
            LoadState.CRAWL: (self.crawl, self.crawl_stays),
        }


class Balanced(NamedTuple):
    """A window as the filter takes it."""

    duration: float  # s since the last one
    balance: TipBalance
    moving: Flags  # (j,) in one direction throughout
    standing: Flags  # (j,) throughout; a joint that is neither starts, stops or turns
    upwards: Flags  # (j,) the direction in which it moves
    crawling: Array  # (j,) how near to stopping, 0 to 1
    by_place: Array  # (j, j) force for a standard deviation of each position; 0 of measured ones
    unmeasured: Flags  # (j,) whose motion no encoder measures that is to be believed
    noise: Array  # (j,) N m, N: standard deviation of the balance by noise of the pressures
    shaken: Array  # (j, j) covariance of the accelerations by noise of the encoders


class LoadFilter:
    """State of `KINDS_FROM + len(LoadState) j` numbers; see the equation above."""

    def __init__(self, doubt: ModelDoubt, joints: int):
        self.doubt, self.joints = doubt, joints
        size = KINDS_FROM + len(LoadState) * joints
        self.x, spread, self._stay = np.zeros(size), np.zeros(size), np.full(size, np.inf)
        spread[TARE] = doubt.tool
        for kind, (deviation, stays) in doubt.kinds.items():
            spread[self.of(kind)], self._stay[self.of(kind)] = deviation, stays
        self.prior = spread.copy()
        spread[MASS], spread[MOMENT] = doubt.unknown, doubt.unknown * FAR
        self.P = np.diag(spread**2)
        self._held = np.zeros(joints, dtype=bool)

    def of(self, kind: LoadState) -> slice:
        """The states of a kind, by joint."""
        begin = KINDS_FROM + kind * self.joints
        return slice(begin, begin + self.joints)

    def copy(self) -> Self:
        copied = copy(self)
        copied.x, copied.P, copied._held = self.x.copy(), self.P.copy(), self._held.copy()
        return copied

    def another_load(self) -> None:
        """A load came or went: nothing is known of it, nor of friction where a joint stands."""
        _forget(self.x, self.P, MASS, self.doubt.unknown)
        _forget(self.x, self.P, MOMENT, self.doubt.unknown * FAR)
        for place in range(*self.of(LoadState.STICK).indices(len(self.x))):
            _forget(self.x, self.P, place, self.doubt.held)

    def tare(self) -> None:
        """What hangs at the tip counts as nothing from now on."""
        if abs(self.x[MASS]) < 3.0 * np.sqrt(self.P[MASS, MASS]):  # it was nothing
            H = np.eye(2, len(self.x))
            correct(self.x, self.P, H, -self.x[:2], np.full(2, TARED**2), len(self.x))
            return
        move = np.eye(len(self.x))
        move[TARE, MASS] = 1.0
        move[MASS], move[MOMENT] = 0.0, 0.0
        self.x, self.P = move @ self.x, move @ self.P @ move.T
        self.P[[MASS, MOMENT], [MASS, MOMENT]] += TARED**2

    def innovation(self, window: Balanced) -> tuple[Array, Array, Array]:
        """Slopes (j, size), innovations (j,) and the covariance (j, j) of their noise."""
        return innovation(self.x, window, self.doubt)[:3]

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
    stick = KINDS_FROM + LoadState.STICK * joints
    for j in range(joints):
        if not window.moving[j] and not window.standing[j]:
            decay[stick + j] = np.exp(-window.duration / doubt.slip_stays)
    added = (1.0 - decay**2) * prior**2
    added[MASS] += doubt.drift**2 * window.duration
    relax(x, P, decay, added)
    for j in range(joints):
        if not window.moving[j] and not held[j]:
            _forget(x, P, stick + j, doubt.held)
        held[j] = not window.moving[j]


@njit(cache=True, error_model="numpy")
def innovation(x: Array, window: Balanced, doubt: ModelDoubt) -> tuple[Array, Array, Array, Array]:
    """Slopes (j, size) about the state x (size,), innovations (j,), the covariance (j, j) of their
    noise, and that of the noise of accelerations with it (j, j).
    """
    balance, joints = window.balance, len(window.moving)
    H, innovation = np.zeros((joints, len(x))), np.zeros(joints)
    variance = np.zeros(joints)
    for j in range(joints):
        moving = window.moving[j]
        up, down = balance.up[j], balance.down[j]
        dry = up if window.upwards[j] else down
        middle, half_range = 0.5 * (up + down), 0.5 * abs(up - down)
        H[j, MASS], H[j, MOMENT], H[j, TARE] = balance.mass[j], balance.moment[j], balance.mass[j]
        lever = 0.0
        for k in range(joints):
            H[j, KINDS_FROM + LoadState.ZERO * joints + k] = balance.by_pressure[j, k]
            H[j, KINDS_FROM + LoadState.SLOW * joints + k] = balance.by_pressure[j, k]
            H[j, KINDS_FROM + LoadState.PLACE * joints + k] = window.by_place[j, k]
            lever += abs(balance.by_pressure[j, k])
        H[j, KINDS_FROM + LoadState.VISCOUS * joints + j] = balance.viscous[j]
        variance[j] = (lever * doubt.noise) ** 2 + window.noise[j] ** 2
        unsure = ESTIMATED_ACCELERATION if window.unmeasured.any() else doubt.inertia
        variance[j] += (unsure * balance.inertial[j]) ** 2
        if window.unmeasured[j]:
            variance[j] += (ESTIMATED_VELOCITY * balance.viscous[j]) ** 2
        sign = 0.0
        carried_place = KINDS_FROM + LoadState.CARRIED * joints + j
        if moving:
            carried = balance.asked[j] - balance.viscous[j] - balance.inertial[j]
            carried = carried + x[MASS] * balance.mass[j]
            sign = np.sign(dry * carried)
            H[j, KINDS_FROM + LoadState.DRY * joints + j] = dry
            H[j, KINDS_FROM + LoadState.CRAWL * joints + j] = dry * window.crawling[j]
            H[j, carried_place] = sign * carried
        else:
            H[j, KINDS_FROM + LoadState.STICK * joints + j] = half_range
            variance[j] += (half_range * doubt.creep) ** 2
        known = balance.asked[j] + (dry if moving else middle)
        innovation[j] = balance.force[j] - known - H[j] @ x
        H[j, MASS] += x[carried_place] * sign * balance.mass[j]
    by_load = balance.inertia_of_load
    inertia = balance.inertia + (x[MASS] + x[TARE]) * by_load[0] + x[MOMENT] * by_load[1]
    shared = window.shaken @ inertia.T
    return H, innovation, np.diag(variance) + inertia @ shared, shared


@njit(cache=True, error_model="numpy")
def take(x: Array, P: Array, window: Balanced, doubt: ModelDoubt) -> float:
    """In place, when the window has begun. See `LoadFilter.take`."""
    H, away, noise, shared = innovation(x, window, doubt)
    spread = H @ P @ H.T + noise
    squared = away @ np.linalg.solve(spread, away)
    likelihood = -0.5 * (TAIL + len(away)) * math.log1p(squared / TAIL)
    likelihood -= 0.5 * np.linalg.slogdet(spread)[1]
    far = np.abs(away) / np.sqrt(np.diag(spread))
    wider = np.diag(np.maximum(1.0, far / WINDOW_OUTLYING))
    noise = wider @ noise @ wider
    # Slopes and innovations share the noise of the accelerations, by which every load would seem
    # lighter. So the slopes take the accelerations that the forces make likely.
    shaken = shared @ np.linalg.solve(H @ P @ H.T + noise, away)
    H[:, MASS] += window.balance.inertia_of_load[0] @ shaken
    H[:, TARE] += window.balance.inertia_of_load[0] @ shaken
    H[:, MOMENT] += window.balance.inertia_of_load[1] @ shaken
    white = np.linalg.inv(np.linalg.cholesky(noise))
    correct(x, P, white @ H, white @ away, np.ones(len(away)), len(x))
    stick = KINDS_FROM + LoadState.STICK * len(window.moving)
    for place in range(stick, stick + len(window.moving)):
        x[place] = min(max(x[place], -1.0), 1.0)
    return likelihood


@njit(cache=True, error_model="numpy")
def _forget(x: Array, P: Array, place: int, deviation: float) -> None:
    """Nothing is known of a state any more but that it is about zero."""
    P[place], P[:, place], x[place] = 0.0, 0.0, 0.0
    P[place, place] = deviation**2


class TipLoad(NamedTuple):
    """What hangs at the tip, beyond what was tared."""

    mass: float  # kg
    deviation: float  # kg, standard deviation
    centre: float  # m beyond the tip, along the line from the last joint; NaN where not known
    centre_deviation: float  # m; NaN where not known


@njit(cache=True, error_model="numpy")
def load_of(x: Array, P: Array) -> TipLoad:
    """From the state x (size,) of a filter and its covariance P (size, size). A load hangs at the
    tip itself unless motion tells that it does not.
    """
    m, s, variance = x[MASS], x[MOMENT], P[MASS, MASS]
    centre, centre_deviation = math.nan, math.nan
    if m > 0.0:
        off = P[MOMENT, MOMENT] - 2.0 * s / m * P[MASS, MOMENT] + (s / m) ** 2 * variance
        off = math.sqrt(max(off, 0.0)) / m
        if off < KNOWN_CENTRE:
            centre, centre_deviation = s / m, off
    if abs(s) < ELSEWHERE * math.sqrt(P[MOMENT, MOMENT]) or math.isnan(centre):
        gain = P[MASS, MOMENT] / (P[MOMENT, MOMENT] + (CENTRED * m) ** 2)
        m, variance = m - gain * s, variance - gain * P[MASS, MOMENT]
    return TipLoad(m, math.sqrt(max(variance, 0.0)), centre, centre_deviation)


def mean_load(loads: Sequence[TipLoad], likely: Sequence[float]) -> TipLoad:
    """The mean of loads of which one hangs there, with what they differ by in its deviation; how
    likely each is, logarithms. Its centre is that of the first.
    """
    share = np.exp(np.array(likely) - max(likely))
    share /= share.sum()
    masses = np.array([load.mass for load in loads])
    variances = np.array([load.deviation**2 for load in loads])
    mean = float(share @ masses)
    variance = float(share @ (variances + (masses - mean) ** 2))
    return loads[0]._replace(mass=mean, deviation=math.sqrt(variance))


def attainable(known: LoadFilter, window: Balanced) -> float:
    """Standard deviation [kg] that an estimate can have in this pose and motion, however long it
    takes: what a model may be wrong about stays.
    """
    H, _, noise = known.innovation(window)
    load, H = H[:, MASS].copy(), H.copy()
    H[:, :KINDS_FROM] = 0.0
    prior = known.prior
    information = load @ np.linalg.solve((H * prior**2) @ H.T + noise, load)
    return math.inf if information <= 0.0 else 1.0 / math.sqrt(float(information))
