"""One window after another: strokes from flow, corrected by encoders and by the force balance.

    x_i(q+) = x_i(q) + (1 + g_i) s_i + n_i N_i                                       prediction
    L_i F_i = tau_i(q, q', q'') + m h_i(q, q', q'') + c_i d_i + v_i f_i + L_i A_i b_i    balance

with length x_i and lever arm L_i of cylinder i (20), (24), the stroke s_i that its flow makes and
N_i what a null does to it, piston force F_i (19), the model tau_i (16) with dry and viscous
friction d_i and f_i, and h_i for a load of 1 kg. Where a joint stands, dry friction may be anything
between its branches.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.hydraulics.stepping import Circuit, chamber_volumes
from crane_model.model_file import Model
from crane_model.whole_crane import circuit_of
from crane_observer.position.balance import ForceBalance, LoadedMechanics
from crane_observer.position.flow import (
    DROP_A,
    DROP_B,
    FLOW_A,
    FLOW_B,
    FORCE,
    LATER,
    LOST_A,
    LOST_B,
    NULL_A,
    NULL_B,
    OPEN,
)
from crane_observer.position.kalman import carry, correct, relax
from crane_observer.position.state import (
    DRY,
    EXTENDING,
    NULL,
    POSITION,
    PRESSURE,
    RETRACTING,
    VISCOUS,
    StateLayout,
    Trust,
)

STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
STARTING = 2  # windows after it stood, in which what friction is, is not known
CORRELATED = 10.0  # windows for which the friction of a joint that stands says the same
SURPRISE = 5.0  # standard deviations of a load that comes or goes, in the sum over some windows
SLACK = 0.75  # of these, a window, that are no surprise
EXPLAINED = 0.6  # of the surprise, what a load must explain of it
OUTLYING = 2.5  # standard deviations, from which on a measurement counts less
SLIP = 0.5  # of the acceleration of a joint that does not move steadily, how wrong it may be
SMALLEST = 1e-12


class FlowWindow(NamedTuple):
    """What was measured in a window of time; j joints."""

    time: float  # s, at its end
    duration: float  # s
    sums: Array  # (j, SUMS) of `crane_observer.position.flow`
    before: Array  # (2, j) Pa in chambers A and B as it began
    after: Array  # (2, j) Pa as it ended
    encoders: Array  # (j,) rad or m at its end; NaN where there is none
    blind: float = 0.0  # s of it in which pressures were not measured


class PoseEstimate(NamedTuple):
    """What is known after a window; j joints."""

    time: float  # s
    position: Array  # (j,)
    velocity: Array  # (j,) mean over the window
    covariance: Array  # (j + 1, j + 1) of positions and load
    load: float  # kg
    surprised: bool  # a load came or went in this window

    @property
    def deviation(self) -> Array:
        """(j + 1,) standard deviations of positions and load."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Known:
    """The model as the filter uses it."""

    mechanics: LoadedMechanics
    circuit: Circuit
    layout: StateLayout
    low: Array  # (j,) the ends of each joint
    high: Array  # (j,)
    standing: Array  # (j,) speed below which it stands
    resolution: Array  # (j,) standard deviation of an encoder
    trust: Trust

    @classmethod
    def of(cls, model: Model, resolution: Array, trust: Trust | None = None) -> "Known":
        """`ConfigurationError` names what the model lacks."""
        mechanics, circuit = LoadedMechanics.of(model), circuit_of(model)
        limits = [mechanics.machine.limits[joint] for joint in model.joints]
        fastest = np.array([min(-one.velocity_min, one.velocity_max) for one in limits])
        return cls(
            mechanics,
            circuit,
            StateLayout(len(model.joints)),
            np.array([one.position_min for one in limits]),
            np.array([one.position_max for one in limits]),
            STANDING * fastest,
            resolution,
            trust or Trust.of(model),
        )


class Filter:
    """The estimate of one start; see the equations above."""

    def __init__(self, known: Known, position: Array, deviation: Array, load: float = 0.0):
        """From `position` (j,), known to `deviation` (j,), with a load known to 1 kg."""
        self.known = known
        layout, trust = known.layout, known.trust
        self.x = np.zeros(layout.size)
        spread = trust.spread(layout)
        spread[layout.of(POSITION)] = deviation
        spread[layout.load] = 1.0
        self.x[layout.of(POSITION)], self.x[layout.load] = position, load
        self.P = np.diag(spread**2)
        self.velocity = np.zeros(layout.joints)
        self._jitter = np.zeros(layout.joints)  # of a position, by noise of pressures
        self._first: tuple[FlowWindow, Array] | None = None
        self.likelihood = 0.0
        self.rows = np.zeros((0, layout.size))  # of the last force balance, of unit variance
        self._stood = np.zeros(layout.joints, dtype=np.int64)
        self._surprise = np.zeros(2)
        self._hidden_load = 0.0  # kg that may have come where all joints stand, by dry friction
        self._spread, self._stay = trust.spread(layout), trust.stay(layout)

    @property
    def position(self) -> Array:
        """(j,) the coordinates."""
        return self.x[self.known.layout.of(POSITION)]

    def step(self, window: FlowWindow) -> PoseEstimate:
        """After one more window."""
        begun = self.position.copy()
        self._drift(window)
        self._move(window)
        self.velocity = (self.position - begun) / window.duration
        seen = np.isfinite(window.encoders)
        if seen.any():
            self._read(window.encoders, seen)
        surprised = False
        self.rows = np.zeros((0, self.known.layout.size))
        if window.blind:
            self._first = None
        elif self._first is None:
            self._first = window, self.velocity
        else:
            surprised = self._weigh(*self._first, window)
            self._first = None
        self._hold_within_the_ends()
        layout = self.known.layout
        kept = np.append(np.arange(layout.joints), layout.load)
        covariance = self.P[np.ix_(kept, kept)]
        covariance[-1, -1] += self._hidden_load**2
        return PoseEstimate(
            window.time,
            self.position.copy(),
            self.velocity,
            covariance,
            float(self.x[layout.load]),
            surprised,
        )

    def _drift(self, window: FlowWindow) -> None:
        decay = np.exp(-window.duration / self._stay)
        added = (1.0 - decay**2) * self._spread**2
        added[self.known.layout.load] = self.known.trust.load_drift**2 * window.duration
        relax(self.x, self.P, decay, added)

    def _move(self, window: FlowWindow) -> None:
        """By the strokes."""
        known, layout = self.known, self.known.layout
        circuit, trust, sums, j = known.circuit, known.trust, window.sums, layout.joints
        q = self.position
        length, lever, bend = known.mechanics.cylinders(q[np.newaxis])[0].T
        volume_a, volume_b = chamber_volumes(circuit, length)
        rise_a, rise_b = window.after - window.before
        swept_a = sums[:, FLOW_A] - volume_a / circuit.bulk_modulus * rise_a
        swept_b = -sums[:, FLOW_B] + volume_b / circuit.bulk_modulus * rise_b
        # each chamber by what a transducer's error does to it
        fastest = known.standing / STANDING * np.abs(lever)
        doubt_a = sums[:, DROP_A] * trust.transducer / circuit.area_a + SMALLEST
        doubt_b = sums[:, DROP_B] * trust.transducer / circuit.area_b + SMALLEST
        doubt_a = doubt_a + sums[:, LOST_A] * fastest
        doubt_b = doubt_b + sums[:, LOST_B] * fastest
        weight_a = doubt_b**2 / (doubt_a**2 + doubt_b**2)
        weight_b = 1.0 - weight_a
        stroke = weight_a * swept_a / circuit.area_a + weight_b * swept_b / circuit.area_b
        by_null = weight_a * sums[:, NULL_A] / circuit.area_a
        by_null -= weight_b * sums[:, NULL_B] / circuit.area_b
        extends = sums[:, OPEN] > 0.0
        gains = np.where(extends, self.x[layout.of(EXTENDING)], self.x[layout.of(RETRACTING)])
        whole = stroke * (1.0 + gains) + by_null * self.x[layout.of(NULL)]
        way = whole / lever
        for _ in range(2):
            after = known.mechanics.cylinders((q + way)[np.newaxis])[0].T
            if not np.isfinite(after).all():
                after = np.stack([length + lever * way, lever, bend])
            way = way - (after[0] - length - whole) / after[1]
        slopes = np.zeros((j, layout.size))
        rows = np.arange(j)
        slopes[rows, rows] = np.clip(lever / after[1], 0.5, 2.0)
        gain = np.where(extends, layout.of(EXTENDING).start, layout.of(RETRACTING).start) + rows
        slopes[rows, gain] = stroke / after[1]
        slopes[rows, layout.of(NULL).start + rows] = by_null / after[1]
        carry(self.P, rows, slopes)
        self.x[layout.of(POSITION)] = q + way
        jitter = weight_a * volume_a / circuit.area_a + weight_b * volume_b / circuit.area_b
        self._jitter = trust.reading * jitter / circuit.bulk_modulus / np.abs(after[1])
        doubt = 1.0 / np.sqrt(1.0 / doubt_a**2 + 1.0 / doubt_b**2)
        noise = ((trust.stroke * stroke) ** 2 + 0.1 * doubt**2) / after[1] ** 2
        noise = noise + (known.standing * window.duration) ** 2 * 1e-4
        if window.blind:
            noise = noise + (known.standing / STANDING * window.blind) ** 2
        self.P[rows, rows] += noise

    def _read(self, encoders: Array, seen: Flags) -> None:
        layout = self.known.layout
        H = np.eye(layout.joints, layout.size)
        variance = np.where(seen, self.known.resolution**2, np.inf)
        innovation = np.where(seen, encoders - self.position, 0.0)
        self.likelihood += correct(self.x, self.P, H, innovation, variance)

    def _weigh(self, first: FlowWindow, before: Array, second: FlowWindow) -> bool:
        """Correct by the force balance between two windows; whether the load changed."""
        known, layout, trust = self.known, self.known.layout, self.known.trust
        j = layout.joints
        duration = first.duration + second.duration
        velocity = (before * first.duration + self.velocity * second.duration) / duration
        acceleration = (self.velocity - before) * 2.0 / duration
        # the difference of two means is the mean of what is between under a triangle
        rising = first.sums[:, LATER] / first.duration
        falling = second.sums[:, FORCE] - second.sums[:, LATER] / second.duration
        force = (rising + falling) * 2.0 / duration
        q = self.position - 0.5 * duration * velocity
        balance = known.mechanics.balance(
            q[np.newaxis], velocity[np.newaxis], acceleration[np.newaxis]
        )
        one = ForceBalance(*(values[0] for values in balance))
        _, lever, bend = known.mechanics.cylinders(q[np.newaxis])[0].T
        slowest = np.minimum(np.abs(before), np.abs(self.velocity))
        change = np.abs(self.velocity - before)  # where it is as fast, it may have turned between
        moves = (slowest > np.maximum(known.standing, change)) & (before * self.velocity > 0.0)
        direction = np.where(moves, np.sign(velocity), 0.0)
        stands = direction == 0.0
        self._stood = np.where(stands, STARTING, np.maximum(self._stood - 1, -1))
        settled = self._stood < 0
        hiding = one.dry / np.maximum(np.abs(one.load), SMALLEST)
        self._hidden_load = float(hiding.min()) if stands.all() else 0.0
        load = self.x[layout.load]
        by_pressure = lever * known.circuit.area_a
        asked = one.smooth + load * one.load
        asked = asked + direction * one.dry * (1.0 + self.x[layout.of(DRY)])
        asked = asked + one.viscous * self.x[layout.of(VISCOUS)]
        asked = asked + by_pressure * self.x[layout.of(PRESSURE)]
        innovation = lever * force - asked
        H = np.zeros((j, layout.size))
        rows = np.arange(j)
        H[:, layout.of(POSITION)] = one.slope + load * one.load_slope
        H[rows, rows] -= bend * force
        H[rows, layout.of(DRY).start + rows] = direction * one.dry
        H[rows, layout.of(VISCOUS).start + rows] = one.viscous
        H[rows, layout.of(PRESSURE).start + rows] = by_pressure
        H[:, layout.load] = one.load
        mass = one.mass + load * one.load_mass
        shaken = math.sqrt(6.0) * 4.0 / duration**2 * self._jitter  # of the acceleration
        # one that sticks and slips does so within a window
        shaken = mass * np.where(settled, shaken, np.maximum(shaken, SLIP * np.abs(acceleration)))
        noise = (by_pressure * trust.noise) ** 2 + (trust.inertia * (mass @ acceleration)) ** 2
        noise = np.diag(noise + np.where(settled, 0.0, one.dry**2)) + shaken @ shaken.T
        surprised = self._surprised(H, innovation, noise, bool(settled.any()))
        if surprised:
            self.P[layout.load, layout.load] += trust.load**2
        often = np.sqrt(np.where(settled, 1.0, CORRELATED))
        white = np.linalg.inv(np.linalg.cholesky(noise * np.outer(often, often)))
        H, innovation = white @ H, white @ innovation
        away = np.abs(innovation) / np.sqrt(1.0 + np.einsum("ik,kl,il->i", H, self.P, H))
        variance = np.maximum(1.0, away / OUTLYING) ** 2  # Huber: an outlier counts less
        self.rows = H
        self.likelihood += correct(self.x, self.P, H, innovation, variance)
        return surprised

    def _surprised(self, H: Array, innovation: Array, noise: Array, moving: bool) -> bool:
        """Whether the innovations ask for another load: two-sided CUSUM of their projection."""
        load = H[:, self.known.layout.load]
        spread = np.linalg.solve(H @ self.P @ H.T + noise, np.stack([load, innovation], 1))
        information = float(load @ spread[:, 0])
        if information <= 0.0:
            return False
        away = float(load @ spread[:, 1]) / math.sqrt(information)
        if away**2 < EXPLAINED * float(innovation @ spread[:, 1]):
            away = 0.0  # something else
        if moving:
            signs = np.array([1.0, -1.0])
            self._surprise = np.maximum(self._surprise + signs * away - SLACK, 0.0)
        if max(abs(away), self._surprise.max()) < SURPRISE:
            return False
        self._surprise[:] = 0.0
        return True

    def _hold_within_the_ends(self) -> None:
        known = self.known
        self.x[known.layout.of(POSITION)] = np.clip(self.position, known.low, known.high)
