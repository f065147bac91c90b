"""What the residuals of the last minutes sum up to."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from crane_model.array import Array, Flags
from crane_observer.monitor.blocks import BLOCK, FlowBlock

# What the model is off by on a machine, always and alike: learnt, and taken off the residuals.
#
# A transducer whose zero is off makes a flow that follows the slope of the valve's edge at the
# pressures of the moment, so it shows most where an edge has next to no pressure left; what the
# identification made of it is an error of the gains, up and down. A dead zone that is off makes the
# slowest motions err most, and oil that is softer each change of pressure. A valve that follows its
# command later or sooner than the model says errs with each change of its opening; of a joint that
# hunts, all that adds up. A leak that is not that of the model creeps while the joint stands. In a
# block
#
#     r = zero S + up X + down X' + wider N - wider' N' + softer C + late W + leak Y
#
# with S what a transducer adds that is 1 Pa off, X and X' the way of the piston that extends and
# retracts, N and N' what an opening wider by the whole stroke adds on it, C oil that is twice as
# soft, W a spool that moves 1 s later, and Y a leak of 1 m3/(s Pa) past the piston. What changes
# with the time of day stays in the residuals, and in their tolerance.

SPAN = 20  # blocks, over which what encoders round hardly counts
EXPECTED = np.array([1e5, 0.02, 0.02, 2e-4, 2e-4, 0.05, 5e-3, 1e-13])
"""Standard deviations of zero [Pa], up, down, dead zones [of the stroke], softer, late [s] and leak
[m3/(s Pa)]."""
OUTLYING = 3.0  # times the usual residual, beyond which a span counts less
ROUNDS = 3  # of the fit, each beside what the last one left
TERMS = len(EXPECTED)


def regressors(
    pressed: Array, course: Array, null: Array, squeezed: Array, late: Array, leak: Array
) -> Array:
    """(n, c, TERMS) of blocks whose transducers add `pressed` (n, c) m/Pa, openings `null` m,
    oil `squeezed` m, spools `late` m/s and leaks `leak` m s-1 Pa m-3 while the piston goes
    `course` (n, c) m.
    """
    extending, retracting = np.maximum(course, 0.0), np.minimum(course, 0.0)
    opens, closes = null * (course > 0.0), -null * (course < 0.0)
    return np.stack([pressed, extending, retracting, opens, closes, squeezed, late, leak], axis=-1)


def fitted(recordings: Sequence[tuple[Array, Array]]) -> Array:
    """(c, TERMS) from residuals (n, c) of blocks and their regressors (n, c, TERMS)."""
    residual = np.concatenate([_spans(one) for one, _ in recordings])
    columns = np.concatenate([_spans(one) for _, one in recordings])
    return np.array(
        [_robust(residual[:, c], columns[:, c]) for c in range(residual.shape[1])]
    ).reshape(-1, TERMS)


def _spans(blocks: Array) -> Array:
    whole = len(blocks) // SPAN
    return blocks[: whole * SPAN].reshape(whole, SPAN, *blocks.shape[1:]).sum(axis=1)


def _robust(residual: Array, columns: Array) -> Array:
    """(TERMS,) by Huber's loss, with what is to be expected as measurements."""
    moving = np.any(columns != 0.0, axis=1)
    columns, residual = columns[moving] * EXPECTED, residual[moving]
    share = np.zeros(TERMS)
    for _ in range(ROUNDS):
        usual = float(np.median(np.abs(residual - columns @ share))) if len(residual) else 0.0
        if usual == 0.0:
            break
        weighted, target = columns / usual, residual / usual

        def left(x: Array, columns: Array = weighted, target: Array = target) -> Array:
            return np.concatenate([columns @ x - target, x])

        share = least_squares(left, share, loss="huber", f_scale=OUTLYING).x
    return np.asarray(share * EXPECTED)


KEPT = 1200  # blocks, a minute


class Sums(NamedTuple):
    """Sums since the beginning at the ends of n blocks; c channels: chambers A and B of each joint
    from base to tip, and the supply.
    """

    time: Array  # (n,) s
    residual: Array  # (n, c) m, for the supply Pa
    way: Array  # (n, c) m that the piston has gone, for the supply Pa of droop
    drop: (
        Array  # (n, c) m/Pa that a transducer off by 1 Pa adds, for the supply the count of blocks
    )
    turned: Array  # (n, c) m/s by which the speed of the piston changed, up and down alike
    edge: Array  # (n, c) m that the piston goes by edges which may be open, or not
    trim: Array  # (n, c, TERMS) the regressors of what is learnt to be always off

    def channel(self, c: int) -> "Sums":
        """That one alone."""
        return Sums(self.time, *(part[:, c : c + 1] for part in self[1:]))


class Added(NamedTuple):
    """What a block adds to `Sums`, but for the time."""

    residual: Array  # (c,)
    way: Array  # (c,)
    drop: Array  # (c,)
    turned: Array  # (c,)
    edge: Array  # (c,)
    trim: Array  # (c, TERMS)


def of_block(block: FlowBlock, trusted: Flags | None = None) -> Added:
    """Nothing where the flow is not known, nor of the supply where it feeds a chamber of which the
    transducer is not one of those `trusted` (j, 2), by default all.
    """
    known = block.known.ravel()
    feeding = block.feeding and (trusted is None or bool(trusted[block.fed != 0.0].all()))
    residual = np.where(known, (block.encoder[:, None] - block.flow).ravel(), 0.0)
    moved = np.maximum(
        np.abs(block.encoder), np.where(block.known, np.abs(block.flow), 0.0).max(axis=1)
    )
    way = np.where(known, np.repeat(moved, 2), 0.0)
    pressed = np.where(known, block.drop.ravel(), 0.0)
    trim = np.zeros((len(known) + 1, TERMS))
    course = np.repeat(block.encoder, 2)
    of_flow = (block.null, block.squeezed, block.late, block.leak)
    rest = np.array([course, *(part.ravel() for part in of_flow)])
    trim[:-1] = regressors(pressed, *np.where(known, rest, 0.0))
    return Added(
        np.append(residual, block.supply if feeding else 0.0),
        np.append(way, block.drawn.sum()),
        np.append(np.abs(pressed), float(feeding)),
        np.append(np.where(known, block.turned.ravel(), 0.0), 0.0),
        np.append(np.where(known, block.edge.ravel(), 0.0), 0.0),
        trim,
    )


def summed(times: Sequence[float], added: Sequence[Added]) -> Sums:
    """Of all blocks of a recording."""
    columns = (np.cumsum(part, axis=0) for part in zip(*added, strict=True))
    return Sums(np.array(times), *columns)


class History:
    """The last blocks, and their sums; the row of the newest is `newest`."""

    def __init__(self, trim: Array):
        """`trim` (c, TERMS): what is taken off the residuals, learnt of this machine."""
        channels = len(trim)
        self._trim = trim
        zeros = np.zeros((2 * KEPT, channels))
        self._sums = Sums(
            np.zeros(2 * KEPT),
            residual=zeros,
            way=zeros.copy(),
            drop=zeros.copy(),
            turned=zeros.copy(),
            edge=zeros.copy(),
            trim=np.zeros((*zeros.shape, TERMS)),
        )
        self._blocks: list[FlowBlock] = []
        self.newest = -1
        self.since_row = np.zeros(channels, dtype=np.int64)  # (c,) no sum begins before it

    @property
    def sums(self) -> Sums:
        """Rows up to `newest` hold."""
        return self._sums

    def add(self, block: FlowBlock, trusted: Flags) -> None:
        """One block more; the oldest are forgotten. (c,) which transducers are `trusted`: by that
        of the supply go chambers that it feeds, by theirs the supply.
        """
        if not trusted[-1]:
            block = block._replace(known=block.known & (block.fed == 0.0))
        if self.newest + 1 == 2 * KEPT:
            for one in self._sums:
                one[:KEPT] = one[KEPT:]
            self._blocks = self._blocks[KEPT:]
            self.newest -= KEPT
            self.since_row = np.maximum(self.since_row - KEPT, 0)
        before = self.newest
        self.newest += 1
        self._blocks.append(block)
        self._sums.time[self.newest] = block.time
        added = of_block(block, trusted[:-1].reshape(-1, 2))
        left = added.residual - np.einsum("ck,ck->c", added.trim, self._trim)
        for one, more in zip(self._sums[1:], added._replace(residual=left), strict=True):
            one[self.newest] = more if before < 0 else one[before] + more

    def forget(self, channels: slice) -> None:
        """Their sums begin with the next block."""
        self.since_row[channels] = self.newest

    def since(self, row: int) -> Sequence[FlowBlock]:
        """The blocks behind a row."""
        return self._blocks[row + 1 : self.newest + 1]

    def known_since(self, onset: float) -> Flags:
        """(j, 2) the chambers whose flow was known in every block that began at `onset` [s] or
        later.
        """
        joints = len(self.since_row) // 2
        known = [block.known for block in self._blocks[: self.newest + 1] if block.begin >= onset]
        return np.all(np.reshape(known, (-1, joints, 2)), axis=0)


# How far sums of residuals went over windows of all lengths, beside how far they may.
#
# The largest share over all windows that end now is a test for a change of the mean that began at
# any time within them (a window-limited generalized likelihood ratio), whose deviation grows with
# what was moved as `crane_observer.monitor.tolerance` has it.

Rows = NDArray[np.int64]
SPANS = 2 ** np.arange(11)  # blocks, over which sums are looked at: from 0.05 to 51 s


def between(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and how far they may by tolerances (c, 6), or
    (6,) that all share.
    """
    moved, by = grown(sums, begin, end)
    return moved, np.asarray((by * tolerance).sum(axis=-1))


def grown(sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and (n, c, 6) what floor, share, zero,
    creep, late and edge are multiplied by.
    """
    moved = np.abs(sums.residual[end] - sums.residual[begin])
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    late, edge = np.abs(sums.turned[end] - sums.turned[begin]), sums.edge[end] - sums.edge[begin]
    ones = np.ones_like(way)
    by = [ones, way, drop, _lasting(begin, end) * ones, late, np.abs(edge)]
    return moved, np.stack(by, axis=-1)


def within(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> Array:
    """(n, c) how far they may if stamps and spools are right, by tolerances (c, 4) of the rest."""
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    floor, share, zero, creep = tolerance.T
    return np.asarray(floor + share * way + zero * drop + creep * _lasting(begin, end))


def _lasting(begin: Rows, end: Rows) -> Array:
    """(n, 1) s between rows."""
    return np.asarray(BLOCK * np.abs(end - begin)[:, None])


def excess(tolerance: Array, history: History) -> tuple[Array, Array]:
    """(c,) the largest share of its tolerance that a sum of each channel takes up to the newest
    block, and the number of blocks over which it does.
    """
    sums, now = history.sums, history.newest
    spans = SPANS[now >= SPANS]
    if not len(spans):
        return np.zeros(len(tolerance)), np.ones(len(tolerance), dtype=int)
    moved, may = between(tolerance, sums, now - spans, np.full(len(spans), now))
    begun = (now - spans)[:, None] >= history.since_row
    taken = np.where(begun, moved / may, 0.0)
    worst = taken.argmax(axis=0)
    return taken[worst, np.arange(len(tolerance))], spans[worst]


def taken(tolerance: Array, sums: Sums) -> Array:
    """(n, c) the same share at each block of a recording."""
    most = np.zeros_like(sums.residual)
    for span in SPANS[len(sums.time) > SPANS]:
        begin = np.arange(len(sums.time) - span)
        moved, may = between(tolerance, sums, begin, begin + span)
        most[span:] = np.maximum(most[span:], moved / may)
    return most
