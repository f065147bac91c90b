"""Where flow moves the cylinders in a window, and how sure that is."""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_model.hydraulics.stepping import chamber_volumes
from crane_observer.position.balance import SMALLEST, Known
from crane_observer.position.flow import (
    DROP_A,
    DROP_B,
    FLOW_A,
    FLOW_B,
    LOST_A,
    LOST_B,
    NULL_A,
    NULL_B,
    NULL_DOUBT,
    OPEN,
)
from crane_observer.position.kalman import Gaussian
from crane_observer.position.state import (
    EXTENDING,
    HELD,
    NULL,
    OFFSET_A,
    OFFSET_B,
    RETRACTING,
    UNEVEN,
    FlowWindow,
)

WHITE = 0.1  # of the variance by transducers that are off, how much is new in each window
CLEAR = 2.0  # times its doubt, a stroke or velocity that is one: a joint may stall
STEEPEST = 2.0  # times, by which a lever arm changes in a window


class Stroke(NamedTuple):
    """Of j cylinders, both chambers together."""

    stroke: Array  # (j,) m, by the flow that the model has
    by_null: Array  # (j,) m for a null of 1
    by_offset_a: Array  # (j,) m for transducers of chambers A off by as much as they are trusted
    by_offset_b: Array  # (j,) m, the same for B
    doubt: Array  # (j,) m, by these, and by nulls that nobody identified
    jitter: Array  # (j,) m for noise of 1 Pa of each pressure
    extends: Flags  # (j,)


class Moved(NamedTuple):
    """Where the joints come to."""

    way: Array  # (j,) rad, m
    slopes: Array  # (j, size) of the new coordinates against the states before
    noise: Array  # (j,) variance
    jitter: Array  # (j,) rad, m: by noise of the readings of pressure
    doubt: Array  # (j,) rad, m: by transducers that are off, also for long


def stroke_of(known: Known, length: Array, lever: Array, window: FlowWindow) -> Stroke:
    """Each chamber counts by what a transducer's error does to it."""
    circuit, trust, sums = known.circuit, known.trust, window.sums
    volume_a, volume_b = chamber_volumes(circuit, length)
    rise_a, rise_b = window.after - window.before
    swept_a = sums[:, FLOW_A] - volume_a / circuit.bulk_modulus * rise_a
    swept_b = -sums[:, FLOW_B] + volume_b / circuit.bulk_modulus * rise_b
    fastest = known.fastest * np.abs(lever)
    # of a flow Q over a drop D, an offset of 1 Pa makes Q / (2 D); gains were identified with the
    # same offset, at half the supply pressure on the mean, and make up for it there
    supply = circuit.supply_pressure
    off_a = (sums[:, DROP_A] - np.abs(sums[:, FLOW_A]) / supply) * trust.transducer / circuit.area_a
    off_b = (sums[:, DROP_B] - np.abs(sums[:, FLOW_B]) / supply) * trust.transducer / circuit.area_b
    kept_a = UNEVEN * trust.transducer * sums[:, DROP_A] / circuit.area_a
    kept_b = UNEVEN * trust.transducer * sums[:, DROP_B] / circuit.area_b
    doubt_a = np.hypot(off_a, kept_a) + SMALLEST
    doubt_b = np.hypot(off_b, kept_b) + SMALLEST
    lost_a, lost_b = sums[:, LOST_A] * fastest, sums[:, LOST_B] * fastest
    doubt_a, doubt_b = doubt_a + lost_a, doubt_b + lost_b
    weight_a = doubt_b**2 / (doubt_a**2 + doubt_b**2)
    part_a, part_b = weight_a / circuit.area_a, (1.0 - weight_a) / circuit.area_b
    by_null = part_a * sums[:, NULL_A] - part_b * sums[:, NULL_B]
    doubt = 1.0 / np.sqrt(1.0 / doubt_a**2 + 1.0 / doubt_b**2)
    return Stroke(
        part_a * swept_a + part_b * swept_b,
        by_null,
        weight_a * (off_a + lost_a),
        (weight_a - 1.0) * (off_b + lost_b),
        np.where(known.assumed, np.hypot(doubt, NULL_DOUBT * by_null), doubt),
        (part_a * volume_a + part_b * volume_b) / circuit.bulk_modulus,
        sums[:, OPEN] > 0.0,
    )


def moved(known: Known, x: Array, q: Array, window: FlowWindow) -> Moved:
    """From coordinates q (j,), with errors of gains and nulls as the states x (size,) have them."""
    layout, trust, cylinders = known.layout, known.trust, known.mechanics.cylinders
    length, lever, bend = cylinders(q[np.newaxis])[0].T
    made = stroke_of(known, length, lever, window)
    gains = np.where(made.extends, x[layout.of(EXTENDING)], x[layout.of(RETRACTING)])
    whole = made.stroke * (1.0 + gains) + made.by_null * x[layout.of(NULL)]
    way = whole / lever
    for _ in range(2):  # steps of Newton's method
        after = cylinders((q + way)[np.newaxis])[0].T
        if not np.isfinite(after).all():
            after = np.stack([length + lever * way, lever, bend])
        way = way - (after[0] - length - whole) / after[1]
    slopes, rows = np.zeros((layout.joints, layout.size)), np.arange(layout.joints)
    slopes[rows, rows] = np.clip(lever / after[1], 1.0 / STEEPEST, STEEPEST)
    gain = np.where(made.extends, layout.of(EXTENDING).start, layout.of(RETRACTING).start) + rows
    slopes[rows, gain] = made.stroke / after[1]
    slopes[rows, layout.of(NULL).start + rows] = made.by_null / after[1]
    slopes[rows, layout.of(OFFSET_A).start + rows] = made.by_offset_a / after[1]
    slopes[rows, layout.of(OFFSET_B).start + rows] = made.by_offset_b / after[1]
    noise = ((known.stroke * made.stroke) ** 2 + WHITE * made.doubt**2) / after[1] ** 2
    noise = noise + (known.standing * window.duration) ** 2 * 1e-4
    noise = noise + (known.fastest * window.blind) ** 2
    jitter, doubt = trust.reading * made.jitter, made.doubt
    return Moved(way, slopes, noise, jitter / np.abs(after[1]), doubt / np.abs(after[1]))


# Which joints move and which stand, and what dry friction is where it is not that of a motion.

STARTING = 2  # force balances after it stood, in which what friction is, is not known
STARTING_UNKNOWN = 8  # the same of a joint whose valve is not identified, as it may stick and slip
COMING_TO_REST = 3  # force balances of a joint that stands, until what holds it stays what it is
CREEP = 0.25  # of what holds it is lost while the time that it stands grows e-fold
LARGEST = 1.5  # of dry friction, that holds a joint: with what the model lacks of it
ANOTHER = 0.1  # of dry friction, by which what it has to hold must change to count


class Motions(NamedTuple):
    """Of j joints in a force balance."""

    direction: Array  # (j,) 1, -1; 0 where it does not move steadily
    moves: Flags  # (j,) long enough that friction is that of the direction
    held: Flags  # (j,) stands behind a closed valve, and friction is what it was
    passing: Flags  # (j,) from one to the other: friction is anything for a moment

    @property
    def stalls(self) -> Flags:
        """(j,) stands though its valve is open; friction may be anything for long."""
        return ~(self.moves | self.held | self.passing)


class Resting:
    """For how long each joint of `known` has stood. Arrays are replaced and never written to, so
    that a shallow copy is one to go back to.
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
        """Whether every joint is held."""
        return bool((self._rested > COMING_TO_REST).all())

    def judge(self, before: Array, after: Array, doubt: Array, opened: Flags) -> Motions:
        """From velocities (j,) in two windows, how far they may be off (j,), and which valves were
        open (j,).
        """
        slowest = np.minimum(np.abs(before), np.abs(after))
        change = np.abs(after - before)  # where it is as fast, it may have turned between
        least = np.maximum.reduce([self._known.standing, change, CLEAR * doubt])
        steady = (slowest > least) & (before * after > 0.0)
        direction = np.where(steady, np.sign(before + after), 0.0)
        self._stood = np.where(steady, np.maximum(self._stood - 1, -1), self._starting)
        self._slow = np.where(steady, 0, self._slow + 1)
        self._rested = np.where(steady | opened, 0, self._rested + 1)
        moves, held = self._stood < 0, self._rested > COMING_TO_REST
        return Motions(direction, moves, held, ~moves & ~held & (self._slow <= COMING_TO_REST))

    def hold(self, state: Gaussian, asked: Array, dry: Array) -> None:
        """Friction of those that are held, in place.

        It is drawn where a joint has come to rest. It changes as far as what it has to hold,
        `asked` (j,) beside it, changes by as much as `dry` (j,), and a little with the logarithm
        of time, by which friction ages. What changed is less sure and not drawn anew: friction
        that is large would push positions with every draw.
        """
        known, layout = self._known, self._known.layout
        change = np.abs(asked - self._asked)
        counts = change > ANOTHER * dry
        lost = CREEP / np.maximum(self._rested, 1)
        lost = lost + np.where(counts, change / np.maximum(dry, SMALLEST), 0.0)
        drawn = self._rested <= COMING_TO_REST + 1
        self._asked = np.where(counts | drawn, asked, self._asked)
        decay, added = np.ones(layout.size), np.zeros(layout.size)
        decay[layout.of(HELD)] = np.where(drawn, 0.0, 1.0)
        held, most = np.diag(state.P)[layout.of(HELD)], known.trust.held**2
        wider = np.minimum((1.0 - np.exp(-2.0 * lost)) * most, np.maximum(most - held, 0.0))
        added[layout.of(HELD)] = np.where(drawn, most, wider)
        state.relax(decay, added)
        friction = state.x[layout.of(HELD)]
        friction[:] = np.clip(friction, -LARGEST, LARGEST)
