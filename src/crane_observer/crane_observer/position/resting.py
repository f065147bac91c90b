"""Which joints move and which stand, and what dry friction is where it is not that of a motion."""

from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.position.gaussian import Gaussian
from crane_observer.position.known import SMALLEST, Known
from crane_observer.position.state import HELD
from crane_observer.position.strokes import CLEAR

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
