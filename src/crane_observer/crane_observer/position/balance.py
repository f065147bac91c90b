"""The model as the filter uses it: strokes by flow, the force balance, joints at rest."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.chain.dynamics import inverse_dynamics, tip_bodies
from crane_model.hydraulics.simulation import circuit_of, identified
from crane_model.hydraulics.stepping import Circuit, chamber_volumes
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_observer.position.flow import ASSUMED_VALVE, Served
from crane_observer.position.state import (
    GAIN_LEFTOVER,
    NUDGE,
    STANDING,
    FlowWindow,
    Gaussian,
    Pair,
    StateLayout,
    Trust,
    flow_share,
    null_deviation,
)

SMALLEST = 1e-12  # of any unit, where nothing may be 0

WHITE_SHARE = 0.1  # of the variance by transducers that are off, that is new in each window
CLEAR_MOTION = 2.0  # times its doubt, a stroke or velocity that is one: a joint may stall
STEEPEST_LEVER = 2.0  # times, by which a lever arm changes in a window

STARTING = 2  # force balances after it stood, in which friction is not known
STARTING_UNKNOWN = 8  # the same of a joint whose valve is not identified, as it may stick and slip
COMING_TO_REST = 3  # force balances of a joint that stands, until what holds it stays what it is
FRICTION_CREEP = 0.25  # of what holds it is lost while the time that it stands grows e-fold
LARGEST_HELD = 1.5  # of dry friction, that holds a joint: with what the model lacks of it
HELD_CHANGE = 0.1  # of dry friction, by which what it has to hold must change to count

UNKNOWN_FRICTION_ROWS = 10.0  # force balances, for which friction that is not known says the same
READING_NOISE_LEFT = 0.33  # of a reading, in a mean of both chambers over two windows
SLIP = 0.5  # of the acceleration of a joint that does not move steadily, how wrong it may be


class ForceBalance(NamedTuple):
    """At n motions of j joints. Forces are generalized, [N m, N]."""

    smooth: Array  # (n, j) of the model without dry friction
    dry: Array  # (n, j) dry friction, to be taken with the sign of the motion
    viscous: Array  # (n, j) the part that grows with the joint's velocity, at this velocity
    mass: Array  # (n, j, j) the mass matrix
    load: Array  # (n, j) of a mass of 1 kg at the tip
    slope: Array  # (n, j, j) of the smooth force, row by joint, against each coordinate
    load_slope: Array  # (n, j, j) of that of the load
    load_mass: Array  # (n, j, j) what the load adds to the mass matrix, of 1 kg


@dataclass(frozen=True)
class LoadedMechanics:
    """A model with values, and a point mass at the tip of its machine."""

    model: Model
    machine: Machine
    columns: Array  # (j,) where the joints of the model stand among those of the machine
    tip: Array  # (m, 10) the mass of 1 kg, as `crane_model.chain` has bodies

    @classmethod
    def of(cls, model: Model) -> "LoadedMechanics":
        """`ConfigurationError` if the model has no hydraulics or no values."""
        machine, _ = identified(model)
        assert model.theta is not None  # or the error that names the remedy
        columns = np.array([machine.index(joint) for joint in model.joints])
        return cls(model, machine, columns, tip_bodies(machine.chain)[0])

    def cylinders(self, q: Array) -> Array:
        """(n, j) to (n, j, 3): length, lever arm and its derivative; NaN if impossible."""
        joints = self.model.joints
        parts = [self.machine.cylinder(joint, q[:, j]) for j, joint in enumerate(joints)]
        return np.stack(parts, axis=1)

    def balance(self, q: Array, v: Array, a: Array) -> ForceBalance:
        """About coordinates, velocities and accelerations (n, j) each."""
        n, joints = q.shape
        cases = 3 * joints + 2
        position, velocity = np.tile(q, (cases, 1, 1)), np.tile(v, (cases, 1, 1))
        acceleration, direction = np.tile(a, (cases, 1, 1)), np.zeros((cases, n, joints))
        for j in range(joints):
            position[1 + j, :, j] += NUDGE
            acceleration[1 + joints + j, :, j] += 1.0
            velocity[1 + 2 * joints + j, :, j] += NUDGE
        direction[-1] = 1.0
        flat = (-1, joints)
        motion = position.reshape(flat), velocity.reshape(flat), acceleration.reshape(flat)
        rows = np.arange(cases * n)
        record = Record(
            joints=self.model.joints,
            time=rows.astype(float),
            position=motion[0],
            velocity=motion[1],
            acceleration=motion[2],
            run=rows,  # nothing is remembered from one row to the next
            direction_known=direction.reshape(flat),
        )
        force = self.model.predict(record).reshape(cases, n, joints)
        carried = self._carried(*(part[: (1 + 2 * joints) * n] for part in motion))
        carried = carried.reshape(1 + 2 * joints, n, joints)
        damping = (force[1 + 2 * joints : -1] - force[0]) / NUDGE
        return ForceBalance(
            smooth=force[0],
            dry=np.maximum(force[-1] - force[0], 0.0),
            viscous=np.einsum("jnj->nj", damping) * v,
            mass=(force[1 + joints : 1 + 2 * joints] - force[0]).transpose(1, 2, 0),
            load=carried[0],
            slope=((force[1 : 1 + joints] - force[0]) / NUDGE).transpose(1, 2, 0),
            load_slope=((carried[1 : 1 + joints] - carried[0]) / NUDGE).transpose(1, 2, 0),
            load_mass=(carried[1 + joints :] - carried[0]).transpose(1, 2, 0),
        )

    def _carried(self, q: Array, v: Array, a: Array) -> Array:
        """(n, j) forces of 1 kg at the tip, the other joints of the machine at rest."""
        whole = np.zeros((3, len(q), len(self.machine.joint_names)))
        whole[:, :, self.columns] = q, v, a
        return inverse_dynamics(self.machine.chain, self.tip, *whole)[:, self.columns]


@dataclass(frozen=True)
class Known:
    """State of the filter for j joints."""

    mechanics: LoadedMechanics
    circuit: Circuit
    layout: StateLayout
    low: Array  # (j,) the ends of each joint
    high: Array  # (j,)
    fastest: Array  # (j,) that each may move
    resolution: Array  # (j,) standard deviation of an encoder, as far as it is known by now
    reading: Array  # (j,) Pa, the same of a pressure
    trust: Trust
    flow: Array  # (j,) share of the deviations of flow that its identification leaves
    null: Array  # (j,) of the stroke, standard deviation of the null of each valve
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model, resolution: Array, trust: Trust | None = None) -> "Known":
        """`ConfigurationError` names what the model lacks."""
        model, assumed = Served.of(model)
        mechanics = LoadedMechanics.of(model)
        ranges = mechanics.machine.ranges(model.joints)
        trust, flow = trust or Trust.of(model), flow_share(model)
        return cls(
            mechanics,
            circuit_of(model),
            StateLayout.of(len(model.joints)),
            ranges.low,
            ranges.high,
            ranges.slower_speed,
            resolution,
            np.full(len(model.joints), trust.reading),
            trust,
            flow,
            # the deviation of a small flow is mostly noise
            null_deviation(model, trust.null * flow**2),
            assumed,
        )

    @property
    def spread(self) -> Array:
        """(size,) standard deviations of states of which nothing is known, as `Trust.spread`."""
        found = self.trust.spread(self.layout)
        uneven = GAIN_LEFTOVER * self.trust.transducer / self.circuit.supply_pressure
        for gains in (self.layout.extending, self.layout.retracting):
            found[gains] = np.hypot(found[gains] * self.flow, uneven)
            found[gains][self.assumed] = ASSUMED_VALVE.gain_doubt
        found[self.layout.null] = self.null
        return found

    @property
    def stay(self) -> Array:
        """(size,) s that errors stay, as `Trust.stay`."""
        found = self.trust.stay(self.layout)
        for gains in (self.layout.extending, self.layout.retracting):
            found[gains][self.assumed] = ASSUMED_VALVE.gain_stays
        return found

    @property
    def load_drift(self) -> float:
        """kg/sqrt(s): behind a valve that is not identified, no surprise tells of a new load."""
        drift = ASSUMED_VALVE.load_drift if self.assumed.any() else self.trust.load_drift
        return drift * self.trust.unknown

    @property
    def stroke(self) -> Array:
        """(j,) of a window's stroke, standard deviation beside those of gains and nulls."""
        return np.where(self.assumed, ASSUMED_VALVE.stroke_doubt, self.trust.stroke * self.flow)

    @property
    def standing(self) -> Array:
        """(j,) speed below which a joint stands."""
        return STANDING * self.fastest

    @property
    def balance_steps(self) -> float:
        """Shortest pairs of windows in a force balance of the length that suits the readings.

        Noise of the pressures moves the pistons by the oil, and so shakes the inertial forces, the
        less the longer the balance lasts, by the square. They shall be shaken no more than by
        pressures as they are trusted.
        """
        return math.sqrt(float(self.reading.max()) / self.trust.reading)


class Stroke(NamedTuple):
    """Strokes of j cylinders, both chambers together."""

    stroke: Array  # (j,) m, by the flow that the model has
    by_null: Array  # (j,) m for a null of 1
    by_offset_a: Array  # (j,) m for transducers of chambers A off by as much as they are trusted
    by_offset_b: Array  # (j,) m, the same for B
    doubt: Array  # (j,) m, by these, and by nulls that nobody identified
    jitter: Array  # (j,) m for noise of 1 Pa of each pressure
    extends: Flags  # (j,)


class Moved(NamedTuple):
    """New positions of the joints."""

    displacement: Array  # (j,) rad, m
    slopes: Array  # (j, size) of the new coordinates against the states before
    noise: Array  # (j,) variance
    jitter: Array  # (j,) rad, m: by noise of the readings of pressure
    doubt: Array  # (j,) rad, m: by transducers that are off, also for long


def stroke_of(known: Known, length: Array, lever: Array, window: FlowWindow) -> Stroke:
    """Each chamber counts by what a transducer's error does to it."""
    circuit, off, sums = known.circuit, known.trust.transducer, window.sums
    volume_a, volume_b = chamber_volumes(circuit, length)
    rise_a, rise_b = window.after - window.before
    flow, drop, areas = sums["flow"].T, sums["drop"].T, (circuit.area_a, circuit.area_b)
    swept_a = flow[0] - volume_a / circuit.bulk_modulus * rise_a
    swept_b = -flow[1] + volume_b / circuit.bulk_modulus * rise_b
    fastest = known.fastest * np.abs(lever)
    # of a flow Q over a drop D, an offset of 1 Pa makes Q / (2 D); gains were identified with the
    # same offset, at half the supply pressure on the mean, and make up for it there
    supply = circuit.supply_pressure
    offset = [(drop[c] - np.abs(flow[c]) / supply) * off / areas[c] for c in (0, 1)]
    kept = [GAIN_LEFTOVER * off * drop[c] / areas[c] for c in (0, 1)]
    lost = [sums["lost"][:, c] * fastest for c in (0, 1)]
    doubt_a, doubt_b = (np.hypot(offset[c], kept[c]) + SMALLEST + lost[c] for c in (0, 1))
    weight_a = doubt_b**2 / (doubt_a**2 + doubt_b**2)
    part_a, part_b = weight_a / circuit.area_a, (1.0 - weight_a) / circuit.area_b
    by_null = part_a * sums["null"][:, 0] - part_b * sums["null"][:, 1]
    doubt = 1.0 / np.sqrt(1.0 / doubt_a**2 + 1.0 / doubt_b**2)
    return Stroke(
        part_a * swept_a + part_b * swept_b,
        by_null,
        weight_a * (offset[0] + lost[0]),
        (weight_a - 1.0) * (offset[1] + lost[1]),
        np.where(known.assumed, np.hypot(doubt, ASSUMED_VALVE.null_doubt * by_null), doubt),
        (part_a * volume_a + part_b * volume_b) / circuit.bulk_modulus,
        sums["extending"] > 0.0,
    )


def moved(known: Known, x: Array, q: Array, window: FlowWindow) -> Moved:
    """From coordinates q (j,), with errors of gains and nulls as the states x (size,) have them."""
    layout, cylinders = known.layout, known.mechanics.cylinders
    length, lever, bend = cylinders(q[np.newaxis])[0].T
    made = stroke_of(known, length, lever, window)
    gains = np.where(made.extends, x[layout.extending], x[layout.retracting])
    whole = made.stroke * (1.0 + gains) + made.by_null * x[layout.null]
    displacement = whole / lever
    for _ in range(2):  # steps of Newton's method
        after = cylinders((q + displacement)[np.newaxis])[0].T
        if not np.isfinite(after).all():
            after = np.stack([length + lever * displacement, lever, bend])
        displacement = displacement - (after[0] - length - whole) / after[1]
    slopes, rows = np.zeros((layout.joints, layout.size)), np.arange(layout.joints)
    slopes[rows, rows] = np.clip(lever / after[1], 1.0 / STEEPEST_LEVER, STEEPEST_LEVER)
    gain = np.where(made.extends, layout.extending.start, layout.retracting.start) + rows
    slopes[rows, gain] = made.stroke / after[1]
    slopes[rows, layout.null.start + rows] = made.by_null / after[1]
    slopes[rows, layout.offset_a.start + rows] = made.by_offset_a / after[1]
    slopes[rows, layout.offset_b.start + rows] = made.by_offset_b / after[1]
    noise = ((known.stroke * made.stroke) ** 2 + WHITE_SHARE * made.doubt**2) / after[1] ** 2
    noise = noise + (known.standing * window.duration) ** 2 * 1e-4
    noise = noise + (known.fastest * window.blind) ** 2
    jitter, doubt = known.reading * made.jitter, made.doubt
    return Moved(displacement, slopes, noise, jitter / np.abs(after[1]), doubt / np.abs(after[1]))


class Motions(NamedTuple):
    """How j joints move in a force balance."""

    direction: Array  # (j,) 1, -1; 0 where it does not move steadily
    moves: Flags  # (j,) long enough that friction is that of the direction
    held: Flags  # (j,) stands behind a closed valve, and friction is what it was
    passing: Flags  # (j,) from one to the other: friction is anything for a moment

    @property
    def stalls(self) -> Flags:
        """(j,) stands though its valve is open; friction may be anything for long."""
        return ~(self.moves | self.held | self.passing)


class Resting:
    """For how long each joint of `known` has stood, and what dry friction is then. Arrays are
    replaced and never written to, so that a shallow copy is one to go back to.
    """

    def __init__(self, known: Known):
        j = known.layout.joints
        self._known = known
        self._starting = np.where(known.assumed, STARTING_UNKNOWN, STARTING)
        self._stood = np.zeros(j, dtype=np.int64)  # until it moves, counted down
        self._slow = np.zeros(j, dtype=np.int64)  # force balances without motion
        self._rested = np.zeros(j, dtype=np.int64)  # of these, with closed valves, the last ones
        self._asked = np.zeros(j)  # what held it when that last counted

    @property
    def all_stand(self) -> bool:
        return bool((self._rested > COMING_TO_REST).all())

    def judge(self, pair: Pair, doubt: Array) -> Motions:
        """The motions of two windows, with the possible errors (j,) of their velocities."""
        (before, after), opened, steps = pair.velocities, pair.opened, pair.steps
        slowest = np.minimum(np.abs(before), np.abs(after))
        change = np.abs(after - before)  # where it is as fast, it may have turned between
        least = np.maximum.reduce([self._known.standing, change, CLEAR_MOTION * doubt])
        steady = (slowest > least) & (before * after > 0.0)
        direction = np.where(steady, np.sign(before + after), 0.0)
        self._stood = np.where(steady, np.maximum(self._stood - steps, -1), self._starting)
        self._slow = np.where(steady, 0, self._slow + steps)
        self._rested = np.where(steady | opened, 0, self._rested + steps)
        moves, held = self._stood < 0, self._rested > COMING_TO_REST
        return Motions(direction, moves, held, ~moves & ~held & (self._slow <= COMING_TO_REST))

    def hold(self, state: Gaussian, asked: Array, dry: Array, steps: int) -> None:
        """Friction of joints that are held, in place.

        It is drawn where a joint has come to rest. It changes as far as what it has to hold,
        `asked` (j,) beside it, changes by as much as `dry` (j,), and a little with the logarithm
        of time, by which friction ages. What changed is less sure and not drawn anew: friction
        that is large would push positions with every draw.
        """
        layout, most = self._known.layout, self._known.trust.held**2
        change = np.abs(asked - self._asked)
        counts = change > HELD_CHANGE * dry
        lost = FRICTION_CREEP * steps / np.maximum(self._rested, 1)
        lost = lost + np.where(counts, change / np.maximum(dry, SMALLEST), 0.0)
        drawn = self._rested <= COMING_TO_REST + 1
        self._asked = np.where(counts | drawn, asked, self._asked)
        decay, added = np.ones(layout.size), np.zeros(layout.size)
        decay[layout.held] = np.where(drawn, 0.0, 1.0)
        held = np.diag(state.P)[layout.held]
        wider = np.minimum((1.0 - np.exp(-2.0 * lost)) * most, np.maximum(most - held, 0.0))
        added[layout.held] = np.where(drawn, most, wider)
        state.relax(decay, added)
        state.x[layout.held] = np.clip(state.x[layout.held], -LARGEST_HELD, LARGEST_HELD)


class BalanceRows(NamedTuple):
    """Rows (r,) of `innovation` = H (size,) x + noise, whose covariance is `noise` (r, r)."""

    H: Array
    innovation: Array
    noise: Array
    often: Array  # (r,) how often a row is said over

    def of(self, rows: Flags) -> "BalanceRows":
        noise = self.noise[np.ix_(rows, rows)]
        return BalanceRows(self.H[rows], self.innovation[rows], noise, self.often[rows])

    def white(self) -> tuple[Array, Array]:
        """Slopes and innovation with unit variance."""
        root = np.sqrt(self.often)
        white = np.linalg.inv(np.linalg.cholesky(self.noise * np.outer(root, root)))
        return white @ self.H, white @ self.innovation


def balance_rows(
    known: Known, state: Gaussian, balance: ForceBalance, pair: Pair, motions: Motions,
    cylinders: Array, jitter: Array,
) -> BalanceRows:  # fmt: skip
    """The force balance of two windows, linear in the states about `state`.

    The cylinders are (j, 3) of `LoadedMechanics.cylinders`; `jitter` (j,) [rad, m] is what noise
    does to a position.
    """
    layout, trust, x, P = known.layout, known.trust, state.x, state.P
    _, lever, bend = cylinders.T
    force, load, direction = pair.force, x[layout.load], motions.direction
    by_pressure = lever * known.circuit.area_a
    held = np.where(motions.held, balance.dry, 0.0)
    asked = balance.smooth + load * balance.load
    asked = asked + direction * balance.dry * (1.0 + x[layout.dry]) + held * x[layout.held]
    asked = asked + balance.viscous * x[layout.viscous]
    asked = asked + by_pressure * x[layout.pressure]
    H, rows = np.zeros((layout.joints, layout.size)), np.arange(layout.joints)
    H[:, layout.position] = balance.slope + load * balance.load_slope
    H[rows, rows] -= bend * force
    H[rows, layout.dry.start + rows] = direction * balance.dry
    H[rows, layout.held.start + rows] = held
    H[rows, layout.viscous.start + rows] = balance.viscous
    H[rows, layout.pressure.start + rows] = by_pressure
    H[:, layout.load] = balance.load
    mass = balance.mass + load * balance.load_mass
    shaken = math.sqrt(6.0) * 4.0 / pair.duration**2 * jitter  # of the acceleration
    # a joint that sticks and slips does so within a window
    slips = np.maximum(shaken, SLIP * np.abs(pair.acceleration))
    shaken = mass * np.where(motions.passing, slips, shaken)
    read = READING_NOISE_LEFT * known.reading
    noise = (
        by_pressure**2 * (trust.noise**2 + read**2)
        + (trust.inertia * (mass @ pair.acceleration)) ** 2
    )
    # behind a valve that is not identified a joint may be slower, or stall
    guessed = known.assumed & np.isnan(pair.second.encoders)
    unsure = np.where(guessed, np.abs([balance.viscous, pair.acceleration]), 0.0)
    unsure = ASSUMED_VALVE.gain_doubt * unsure
    noise = noise + unsure[0] ** 2 + mass**2 @ unsure[1] ** 2
    # nonlinear part in a pose that is not known
    spread = np.diag(P)[layout.position]
    noise = noise + (balance.load_slope**2 @ spread) * P[layout.load, layout.load]
    noise = noise + 0.5 * (lever * force) ** 2 * (spread**2).sum()
    unknown = motions.passing | guessed
    noise = np.diag(noise + np.where(unknown, balance.dry**2, 0.0)) + shaken @ shaken.T
    often = np.where(unknown, UNKNOWN_FRICTION_ROWS, 1.0)
    return BalanceRows(H, lever * force - asked, noise, often).of(~motions.stalls)
