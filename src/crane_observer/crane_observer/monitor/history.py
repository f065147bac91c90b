"""What the residuals of the last minutes sum up to."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.monitor.blocks import FlowBlock
from crane_observer.monitor.trim import TERMS, regressors

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
