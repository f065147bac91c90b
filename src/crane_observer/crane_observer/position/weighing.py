"""What the forces of two windows say: a force balance, linear in the states."""

import math
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.position.balance import ForceBalance, Known
from crane_observer.position.flow import FORCE, GAIN_DOUBT, LATER, NULL_A, NULL_B
from crane_observer.position.kalman import Gaussian
from crane_observer.position.state import (
    DRY,
    HELD,
    POSITION,
    PRESSURE,
    VISCOUS,
    FlowWindow,
)
from crane_observer.position.strokes import Motions

CORRELATED = 10.0  # force balances, for which friction that is not known says the same
SEEN = 0.33  # of the noise of a reading, left in a mean of both chambers over two windows
SLIP = 0.5  # of the acceleration of a joint that does not move steadily, how wrong it may be


class Pair(NamedTuple):
    """Two windows, one after the other, and the velocities in them (2, j)."""

    first: FlowWindow
    second: FlowWindow
    velocities: Array

    @property
    def duration(self) -> float:
        """Of both [s]."""
        return self.first.duration + self.second.duration

    @property
    def velocity(self) -> Array:
        """(j,) mean."""
        of_both = np.array([[self.first.duration], [self.second.duration]])
        return np.asarray((of_both * self.velocities).sum(axis=0) / self.duration)

    @property
    def acceleration(self) -> Array:
        """(j,) between them."""
        return np.asarray((self.velocities[1] - self.velocities[0]) * 2.0 / self.duration)

    def without_motion(self, held: Flags) -> "Pair":
        """Those of joints that stand (j,) are noise, and would pass for a load's."""
        return self._replace(velocities=np.where(held, 0.0, self.velocities))

    @property
    def opened(self) -> Flags:
        """(j,) whose valve was open for some time."""
        both = np.abs(self.first.sums) + np.abs(self.second.sums)
        return np.asarray((both[:, [NULL_A, NULL_B]] > 0.0).any(axis=1))

    @property
    def force(self) -> Array:
        """(j,) of the pistons [N]: a difference of mean velocities is the mean acceleration of what
        is between, under a triangle, and so is this.
        """
        rising = self.first.sums[:, LATER] / self.first.duration
        second = self.second.sums
        falling = second[:, FORCE] - second[:, LATER] / self.second.duration
        return np.asarray((rising + falling) * 2.0 / self.duration)


class BalanceRows(NamedTuple):
    """Rows (r,) of `innovation` = H (size,) x + noise, whose covariance is `noise` (r, r)."""

    H: Array
    innovation: Array
    noise: Array
    often: Array  # (r,) how often a row is said over

    def of(self, rows: Flags) -> "BalanceRows":
        """Some of the rows."""
        noise = self.noise[np.ix_(rows, rows)]
        return BalanceRows(self.H[rows], self.innovation[rows], noise, self.often[rows])

    def white(self) -> tuple[Array, Array]:
        """Slopes and innovation with unit variance."""
        root = np.sqrt(self.often)
        white = np.linalg.inv(np.linalg.cholesky(self.noise * np.outer(root, root)))
        return white @ self.H, white @ self.innovation


def weigh(
    known: Known, state: Gaussian, one: ForceBalance, pair: Pair, motions: Motions,
    cylinders: Array, jitter: Array,
) -> BalanceRows:  # fmt: skip
    """At a state, where the cylinders (j, 3) are; `jitter` (j,) [rad, m] is what noise does to a
    position.
    """
    layout, trust, x, P = known.layout, known.trust, state.x, state.P
    _, lever, bend = cylinders.T
    force, load = pair.force, x[layout.load]
    by_pressure = lever * known.circuit.area_a
    direction = motions.direction
    held = np.where(motions.held, one.dry, 0.0)
    asked = one.smooth + load * one.load
    asked = asked + direction * one.dry * (1.0 + x[layout.of(DRY)]) + held * x[layout.of(HELD)]
    asked = asked + one.viscous * x[layout.of(VISCOUS)]
    asked = asked + by_pressure * x[layout.of(PRESSURE)]
    H, rows = np.zeros((layout.joints, layout.size)), np.arange(layout.joints)
    H[:, layout.of(POSITION)] = one.slope + load * one.load_slope
    H[rows, rows] -= bend * force
    H[rows, layout.of(DRY).start + rows] = direction * one.dry
    H[rows, layout.of(HELD).start + rows] = held
    H[rows, layout.of(VISCOUS).start + rows] = one.viscous
    H[rows, layout.of(PRESSURE).start + rows] = by_pressure
    H[:, layout.load] = one.load
    mass = one.mass + load * one.load_mass
    shaken = math.sqrt(6.0) * 4.0 / pair.duration**2 * jitter  # of the acceleration
    # one that sticks and slips does so within a window
    slips = np.maximum(shaken, SLIP * np.abs(pair.acceleration))
    shaken = mass * np.where(motions.passing, slips, shaken)
    read = SEEN * trust.reading
    noise = (
        by_pressure**2 * (trust.noise**2 + read**2)
        + (trust.inertia * (mass @ pair.acceleration)) ** 2
    )
    # behind a valve that is not identified a joint may be slower, or stall
    guessed = known.assumed & np.isnan(pair.second.encoders)
    unsure = GAIN_DOUBT * np.where(guessed, np.abs([one.viscous, pair.acceleration]), 0.0)
    noise = noise + unsure[0] ** 2 + mass**2 @ unsure[1] ** 2
    # what is not linear in a pose that is not known
    spread = np.diag(P)[layout.of(POSITION)]
    noise = noise + (one.load_slope**2 @ spread) * P[layout.load, layout.load]
    noise = noise + 0.5 * (lever * force) ** 2 * (spread**2).sum()
    noise = (
        np.diag(noise + np.where(motions.passing | guessed, one.dry**2, 0.0)) + shaken @ shaken.T
    )
    often = np.where(motions.passing | guessed, CORRELATED, 1.0)
    return BalanceRows(H, lever * force - asked, noise, often).of(~motions.stalls)
