"""What the residuals of the last minutes sum up to."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_observer.monitor.blocks import FlowBlock

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


def of_block(block: FlowBlock) -> tuple[Array, Array, Array]:
    """(c,) what a block adds to residual, way and drop; nothing where the flow is not known."""
    known = np.repeat(block.known, 2)
    residual = np.where(known, (block.encoder[:, None] - block.flow).ravel(), 0.0)
    moved = np.maximum(np.abs(block.encoder), np.abs(block.flow).max(axis=1))
    way = np.where(known, np.repeat(moved, 2), 0.0)
    drop = np.where(known, np.abs(block.drop).ravel(), 0.0)
    return (
        np.append(residual, block.supply if block.feeding else 0.0),
        np.append(way, block.drawn.sum()),
        np.append(drop, float(block.feeding)),
    )


class History:
    """The last blocks, and their sums; the row of the newest is `newest`."""

    def __init__(self, joints: int):
        self._sums = Sums(np.zeros(2 * KEPT), *np.zeros((3, 2 * KEPT, 2 * joints + 1)))
        self._blocks: list[FlowBlock] = []
        self.newest = -1

    @property
    def sums(self) -> Sums:
        """Rows up to `newest` hold."""
        return self._sums

    def add(self, block: FlowBlock) -> None:
        """One block more; the oldest are forgotten."""
        if self.newest + 1 == 2 * KEPT:
            for one in self._sums:
                one[:KEPT] = one[KEPT:]
            self._blocks = self._blocks[KEPT:]
            self.newest -= KEPT
        before = self.newest
        self.newest += 1
        self._blocks.append(block)
        self._sums.time[self.newest] = block.time
        for one, added in zip(self._sums[1:], of_block(block), strict=True):
            one[self.newest] = added if before < 0 else one[before] + added

    def since(self, row: int) -> Sequence[FlowBlock]:
        """The blocks behind a row."""
        return self._blocks[row + 1 : self.newest + 1]
