"""How far residuals go where no sensor lies, learnt from recordings of which that is known.

What is always off is taken off first (`trim`). Between any two blocks the sum of the rest stays
within

    floor + share P + zero S + creep T + late V

with P the way of the piston between them, S what a transducer that is 1 Pa off adds on this way, T
the time and V twice the largest speed between them; for the supply, P is the droop of all flow, S
the number of blocks, and there is no V. `floor` is what noise and rounding do, however long the
way; `share` an error of gains, `zero` one of the zeros, `creep` one of leakage; `late` is how long
after its stamp a command reaches the valve, and how far stamps of readings are off, more than the
model knows.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from crane_model.array import Array
from crane_model.configuration import NonNegative, Positive, Schema
from crane_model.errors import DataError
from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import History, Sums
from crane_observer.monitor.trim import TERMS, fitted

Rows = NDArray[np.int64]
SPANS = 2 ** np.arange(11)  # blocks, over which sums are looked at: from 0.05 to 51 s
ROOM = 1.5  # over the largest that was ever seen
FLOOR, SHARE, ZERO, CREEP, LATE = 4e-5, 1e-3, 1e4, 1e-6, 2e-3  # m, of the way, Pa, m/s and s, least
LEAST = FLOOR, SHARE, ZERO, CREEP, LATE
SUPPLY_FLOOR, SUPPLY_SHARE, SUPPLY_ZERO = 1.5e5, 0.02, 2e3  # Pa, of the droop, and Pa, at least
UNLEARNT = 6.0  # times the least, of a machine that was never recorded without faults; of the
UNLEARNT_SUPPLY = 20.0  # supply, too


class JointTolerance(Schema):
    """Of both chambers of a joint: A, B."""

    floor: tuple[Positive, Positive]  # m
    share: tuple[NonNegative, NonNegative]  # of the way
    zero: tuple[NonNegative, NonNegative]  # Pa
    creep: tuple[NonNegative, NonNegative]  # m/s
    late: tuple[NonNegative, NonNegative]  # s
    off: tuple[float, float] = (0.0, 0.0)  # Pa, always, as gains are:
    up: tuple[float, float] = (0.0, 0.0)  # of the way of a cylinder that extends
    down: tuple[float, float] = (0.0, 0.0)  # and of one that retracts


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
        """(c, 5) floor, share, zero, creep and late of the channels of `Sums`."""
        rows = [
            (joint.floor[i], joint.share[i], joint.zero[i], joint.creep[i], joint.late[i])
            for joint in self.joints.values()
            for i in (0, 1)
        ]
        return np.array([*rows, (self.supply.floor, self.supply.share, self.supply.zero, 0.0, 0.0)])

    @property
    def trim(self) -> Array:
        """(c, TERMS) what is always off of the channels of `Sums`; see `trim`."""
        rows = [
            (joint.off[i], joint.up[i], joint.down[i])
            for joint in self.joints.values()
            for i in (0, 1)
        ]
        return np.array([*rows, (0.0,) * TERMS])


def unlearnt(joints: Sequence[str]) -> Tolerance:
    """Wide enough for a machine of which nothing was learnt."""
    names = tuple(JointTolerance.model_fields)
    one = JointTolerance(**{k: (UNLEARNT * v,) * 2 for k, v in zip(names, LEAST, strict=False)})
    times = UNLEARNT_SUPPLY
    supply = SupplyTolerance(
        floor=times * SUPPLY_FLOOR, share=times * SUPPLY_SHARE, zero=times * SUPPLY_ZERO
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
    trim = fitted([(_blocks(one.residual), _blocks(one.trim)) for one in recordings])
    trim[-1] = 0.0  # that of the supply is identified
    recordings = [
        one._replace(residual=one.residual - np.einsum("nck,ck->nc", one.trim, trim))
        for one in recordings
    ]
    channels = recordings[0].residual.shape[1]
    rows = [
        (*_row([one.channel(c) for one in recordings], supply=c == channels - 1), *trim[c])
        for c in range(channels)
    ]
    names = tuple(JointTolerance.model_fields)
    pairs = {
        joint: JointTolerance(
            **{name: (rows[2 * j][k], rows[2 * j + 1][k]) for k, name in enumerate(names)}
        )
        for j, joint in enumerate(joints)
    }
    floor, share, zero = rows[-1][:3]
    return Tolerance(
        provenance=provenance,
        joints=pairs,
        supply=SupplyTolerance(floor=floor, share=share, zero=zero),
    )


def _blocks(sums: Array) -> Array:
    return np.diff(sums, axis=0, prepend=np.zeros_like(sums[:1]))


def _row(recordings: Sequence[Sums], supply: bool) -> tuple[float, ...]:
    """Floor, share, zero, creep and late of a channel: of all that hold what was seen, those that
    allow least beside the least, in short and long spans alike.
    """
    of_supply = SUPPLY_FLOOR, SUPPLY_SHARE, SUPPLY_ZERO, 0.0, 0.0
    least = np.array(of_supply if supply else LEAST)
    cost, beyond, asked = np.zeros(len(least)), [], []
    for span in SPANS:
        seen = [_seen(one, int(span)) for one in recordings if len(one.time) > span]
        if not seen:
            continue
        moved, by = (np.concatenate(part) for part in zip(*seen, strict=True))
        usual = by.mean(axis=0)
        cost += usual / float(usual @ least)
        over = ROOM * moved > by @ least
        beyond.append(by[over] * least)
        asked.append(ROOM * moved[over])
    rows, wanted = np.concatenate(beyond), np.concatenate(asked)
    if not len(rows):
        return tuple(least.tolist())
    size = wanted[:, None]  # so that small and large count alike within the solver's tolerance
    found = linprog(
        cost * least, -rows / size, -np.ones(len(rows)), bounds=[(1.0, None)] * len(least)
    )
    if found.status != 0:
        raise DataError(f"tolerances: none holds what was seen: {found.message}")
    return tuple((found.x * least).tolist())


def _seen(sums: Sums, span: int) -> tuple[Array, Array]:
    """(n,) how far sums of one channel went in each `span`, and (n, 5) by what they may."""
    begin = np.arange(len(sums.time) - span)
    moved, by = _grown(sums, begin, begin + span)
    return moved[:, 0], by[:, 0]


def between(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and how far they may by tolerances (c, 5), or
    (5,) that all share.
    """
    moved, by = _grown(sums, begin, end)
    return moved, np.asarray((by * tolerance).sum(axis=-1))


def _grown(sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) how far sums went between rows (n,), and (n, c, 5) what floor, share, zero,
    creep and late are multiplied by.
    """
    moved = np.abs(sums.residual[end] - sums.residual[begin])
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    ones, late = np.ones_like(way), 2.0 * _fastest(sums.way, begin, end)
    return moved, np.stack([ones, way, drop, _lasting(begin, end) * ones, late], axis=-1)


def within(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> Array:
    """(n, c) how far they may where stamps are right, by tolerances (c, 4) without `late`."""
    way, drop = np.abs(sums.way[end] - sums.way[begin]), np.abs(sums.drop[end] - sums.drop[begin])
    floor, share, zero, creep = tolerance.T
    return np.asarray(floor + share * way + zero * drop + creep * _lasting(begin, end))


def _lasting(begin: Rows, end: Rows) -> Array:
    """(n, 1) s between rows."""
    return np.asarray(BLOCK * np.abs(end - begin)[:, None])


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
    begun = (now - spans)[:, None] >= history.since_row
    taken = np.where(begun, moved / may, 0.0)
    worst = taken.argmax(axis=0)
    return taken[worst, np.arange(len(tolerance))], spans[worst]
