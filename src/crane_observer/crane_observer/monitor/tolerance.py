"""How far residuals go where no sensor lies, learnt from recordings of which that is known.

Between any two blocks the sum of a residual stays within

    floor + share P + zero S + late V

with P the way of the piston between them, S what a transducer that is 1 Pa off adds on this way, V
twice its largest speed between them; for the supply, P is the droop of all flow, S the number of
blocks, and there is no V. `floor` is what noise and rounding do, however long the way; `share` an
error of gains, `zero` one of the zeros; `late` is how long after its stamp a command reaches the
valve, and how far stamps of readings are off, more than the model knows.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.configuration import NonNegative, Positive, Schema
from crane_model.errors import DataError
from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import History, Sums

Rows = NDArray[np.int64]
SPANS = 2 ** np.arange(11)  # blocks, over which sums are looked at: from 0.05 to 51 s
ROOM = 1.5  # over the largest that was ever seen
SHARE, ZERO = (
    1e-3,
    1e4,
)  # of the way and Pa: in this proportion errors of gains and zeros are learnt
LATE = 2e-3  # s, in the same proportion
SUPPLY_SHARE, SUPPLY_ZERO = 0.2, 1.5e4  # of the droop, and Pa
FLOOR, SUPPLY_FLOOR = 4e-5, 1e6  # m and Pa, at least
FLOORS = 1.25 ** np.arange(16)  # times the least, that are tried
TINY = 1e-3  # of the floor, what share and zero add where nothing moves
LEAST = 1.0  # how many times SHARE, ZERO and LATE, at least
UNLEARNT = 4.0  # how many times, of a machine that was never recorded without faults
UNLEARNT_FLOOR = 2.5e-4  # m, some steps of a coarse encoder


class JointTolerance(Schema):
    """Of both chambers of a joint: A, B."""

    floor: tuple[Positive, Positive]  # m
    share: tuple[NonNegative, NonNegative]  # of the way
    zero: tuple[NonNegative, NonNegative]  # Pa
    late: tuple[NonNegative, NonNegative]  # s


class SupplyTolerance(Schema):
    """Of the supply."""

    floor: Positive  # Pa, summed over blocks
    share: NonNegative  # of the droop
    zero: NonNegative  # Pa


class Tolerance(Schema):
    """Of a machine on the day of the recordings that it was learnt from; a file of its own."""

    provenance: str
    joints: dict[str, JointTolerance]
    supply: SupplyTolerance

    @property
    def rows(self) -> Array:
        """(c, 4) floor, share, zero and late of the channels of `Sums`."""
        rows = [
            (joint.floor[i], joint.share[i], joint.zero[i], joint.late[i])
            for joint in self.joints.values()
            for i in (0, 1)
        ]
        return np.array([*rows, (self.supply.floor, self.supply.share, self.supply.zero, 0.0)])


def unlearnt(joints: Sequence[str]) -> Tolerance:
    """Wide enough for a machine of which nothing was learnt."""
    share, zero, late = UNLEARNT * SHARE, UNLEARNT * ZERO, UNLEARNT * LATE
    one = JointTolerance(
        floor=(UNLEARNT_FLOOR,) * 2, share=(share,) * 2, zero=(zero,) * 2, late=(late,) * 2
    )
    supply = SupplyTolerance(
        floor=2.0 * SUPPLY_FLOOR, share=2.0 * SUPPLY_SHARE, zero=2.0 * SUPPLY_ZERO
    )
    return Tolerance(
        provenance="assumed: nothing was learnt of this machine",
        joints=dict.fromkeys(joints, one),
        supply=supply,
    )


def learn(joints: Sequence[str], recordings: Sequence[Sums], provenance: str) -> Tolerance:
    """From sums of recordings without a fault; `DataError` if there is less than a minute."""
    if sum(len(one.residual) for one in recordings) < 1200:
        raise DataError(
            "tolerances: less than a minute of recording; learn them from the recordings that the "
            "model was identified from, and from work"
        )
    channels = recordings[0].residual.shape[1]
    rows = [_row(recordings, c, supply=c == channels - 1) for c in range(channels)]
    pairs = {
        joint: JointTolerance(
            **{
                name: (rows[2 * j][k], rows[2 * j + 1][k])
                for k, name in enumerate(("floor", "share", "zero", "late"))
            }
        )
        for j, joint in enumerate(joints)
    }
    floor, share, zero, _ = rows[-1]
    return Tolerance(
        provenance=provenance,
        joints=pairs,
        supply=SupplyTolerance(floor=floor, share=share, zero=zero),
    )


def _row(recordings: Sequence[Sums], c: int, supply: bool) -> tuple[float, float, float, float]:
    """Floor, share, zero and late of a channel: of all that hold what was seen, those that together
    allow least, in short and long spans alike.
    """
    beside = (SUPPLY_SHARE, SUPPLY_ZERO, 0.0) if supply else (SHARE, ZERO, LATE)
    least = SUPPLY_FLOOR if supply else FLOOR
    spans = [_seen(one, c, np.array([0.0, *beside])) for one in recordings]
    joined = [np.concatenate([one[k][1] for one in spans]) for k in range(len(SPANS))]
    usual = [float(np.median(one)) for one in joined if len(one)]
    rows = []
    for floor in least * FLOORS:
        beyond = [
            np.max((ROOM * moved - floor) / np.maximum(scale, TINY * floor), initial=LEAST)
            for one in spans
            for moved, scale in one
        ]
        times = max(beyond)
        allowed = sum(math.log(floor + times * one) for one in usual)
        rows.append((allowed, floor, *(times * one for one in beside)))
    return min(rows)[1:]


def _seen(sums: Sums, c: int, tolerance: Array) -> list[tuple[Array, Array]]:
    """How far sums went in each of SPANS, and what they may."""
    seen = []
    for span in SPANS:
        begin = np.arange(max(len(sums.time) - int(span), 0))
        moved, may = between(tolerance, sums, begin, begin + span)
        seen.append((moved[:, c], may[:, c]))
    return seen


def between(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and how far they may by tolerances (c, 4), or
    (4,) that all share.
    """
    moved = np.abs(sums.residual[end] - sums.residual[begin])
    late = tolerance.T[3] * 2.0 * _fastest(sums.way, begin, end)
    return moved, within(tolerance.T[:3].T, sums, begin, end) + late


def within(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> Array:
    """(n, c) how far they may where stamps are right; tolerances without `late`."""
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    floor, share, zero = tolerance.T
    return np.asarray(floor + share * way + zero * drop)


def _fastest(way: Array, begin: Rows, end: Rows) -> Array:
    """(n, c) m/s at most in the blocks from row `begin` to `end` (n,), in either order: by maxima
    over 1, 2, 4, ... blocks, of which two that overlap make every length.
    """
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    oldest = int(low.min(initial=len(way) - 1))
    rows = np.arange(oldest, int(high.max(initial=oldest)) + 1)
    most = (way[rows] - way[np.maximum(rows - 1, 0)]) / BLOCK
    low, high = low - oldest, high - oldest
    level = np.floor(np.log2(high - low + 1)).astype(int)
    found = np.empty((len(low), way.shape[1]))
    for k in range(int(level.max(initial=-1)) + 1):
        here, width = level == k, 2**k
        found[here] = np.maximum(most[low[here]], most[high[here] - width + 1])
        most = np.maximum(most[:-width], most[width:])
    return found


def excess(tolerance: Array, history: History) -> tuple[Array, Array]:
    """(c,) the largest share of its tolerance that a sum of each channel takes up to the newest
    block, and the number of blocks over which it does.
    """
    sums, now = history.sums, history.newest
    spans = SPANS[now >= SPANS]
    if not len(spans):
        return np.zeros(len(tolerance)), np.ones(len(tolerance), dtype=int)
    moved, may = between(tolerance, sums, now - spans, np.full(len(spans), now))
    taken = moved / may
    worst = taken.argmax(axis=0)
    return taken[worst, np.arange(len(tolerance))], spans[worst]
