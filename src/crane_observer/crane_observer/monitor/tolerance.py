"""How far residuals go where no sensor lies, learnt from recordings of which that is known.

What is always off is taken off first (`trim`). Between any two blocks the sum of the rest stays
within

    floor + share P + zero S + creep T + late V + edge E

with P the way of the piston between them, S what a transducer that is 1 Pa off adds on this way, T
the time, V all changes of its speed between them, up and down alike, and E what it would go by
edges of the valve that are open by all their play, while it stands where they may be open or shut;
for the supply, P is the droop of all flow, S the number of blocks, and there is no V and no E.
`floor` is what noise and rounding do, however long the way; `share` an error of gains, `zero` one
of the zeros, `creep` one of leakage; `late` is how long after its stamp a command reaches the
valve, and how far stamps of readings are off, more than the model knows: of a joint that hunts,
each reversal adds to it; `edge` is the share of its play by which a valve may stand elsewhere than
is thought: it passes oil, or does not, for as long as the joint is held.

An alarm takes more of it than `level`, which is what a machine without a fault takes once in APART
(`apart`).
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from crane_model.array import Array
from crane_model.configuration import NonNegative, Positive, Schema
from crane_model.errors import DataError
from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.history import SPANS, TERMS, Sums, fitted, grown, taken

# How large a statistic gets once in a long time, told from the windows of a short one.
#
# What exceeds a high threshold is distributed exponentially beyond it (the generalized Pareto law
# of shape 0, to which the maxima of most distributions come: Pickands 1975), so that once in N
# windows it exceeds
#
#     u + m log(N s)
#
# with s the share of windows above the threshold u, and m their mean excess over it.

ABOVE = 0.2  # share of the windows that is called high
FEWEST = 10  # windows that tell a mean excess


def level(largest: Array, windows: float) -> float:
    """What a statistic exceeds once in `windows`, told from the largest (n,) in each of n.

    `ValueError` unless there is one.
    """
    if not len(largest):
        raise ValueError("level: no window to tell it from; at least one is wanted")
    high = min(max(round(ABOVE * len(largest)), FEWEST), len(largest))
    ordered = np.sort(largest)
    above = ordered[-high:]
    threshold = ordered[-high - 1] if high < len(ordered) else ordered[0]
    rate = high / len(largest)
    return float(threshold + np.mean(above - threshold) * max(math.log(windows * rate), 0.0))


ROOM = 1.5  # over the largest that was ever seen
LEAST = 4e-5, 1e-3, 1e4, 1e-6, 5e-4, 0.2  # m, of the way, Pa, m/s, s, of the play: at least
SUPPLY_FLOOR, SUPPLY_SHARE, SUPPLY_ZERO = 1.5e5, 0.02, 2e3  # Pa, of the droop, and Pa, at least
APART = 10.0  # h between two false alarms
HOUR = 3600.0  # s
WINDOW = 200  # blocks, of which the largest counts as one: longer than residuals err alike
UNLEARNT = 2.4e-4, 6e-3, 6e4, 6e-6, 1.2e-2, 1.0  # the same, of a machine that is not learnt
UNLEARNT_SUPPLY = 20.0  # times the least of the supply, of such a machine


class JointTolerance(Schema):
    """Of both chambers of a joint: A, B."""

    floor: tuple[Positive, Positive]  # m
    share: tuple[NonNegative, NonNegative]  # of the way
    zero: tuple[NonNegative, NonNegative]  # Pa
    creep: tuple[NonNegative, NonNegative]  # m/s
    late: tuple[NonNegative, NonNegative]  # s
    edge: tuple[NonNegative, NonNegative] = LEAST[-1], LEAST[-1]  # of the play
    off: tuple[float, float] = (0.0, 0.0)  # Pa, always, as gains are:
    up: tuple[float, float] = (0.0, 0.0)  # of the way of a cylinder that extends
    down: tuple[float, float] = (0.0, 0.0)  # and of one that retracts
    wider_up: tuple[float, float] = (0.0, 0.0)  # of the stroke that a valve opens more, extending
    wider_down: tuple[float, float] = (0.0, 0.0)  # and retracting
    softer: tuple[float, float] = (0.0, 0.0)  # of what the oil gives way, that it gives more
    later: tuple[float, float] = (0.0, 0.0)  # s that the valve follows later than the model says
    leak: tuple[float, float] = (0.0, 0.0)  # m3/(s Pa) past the piston, more than the model says


NAMES = tuple(JointTolerance.model_fields)[: len(LEAST)]
"""What a tolerance is made of, in the order of LEAST."""
TRIMMED = tuple(JointTolerance.model_fields)[len(LEAST) :]
"""What is taken off, in the order of `trim`."""


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
    level: Positive = 1.0  # share of a tolerance, of which an alarm takes more

    @property
    def rows(self) -> Array:
        """(c, 6) floor, share, zero, creep, late and edge of the channels of `Sums`."""
        rows = [
            tuple(getattr(joint, name)[i] for name in NAMES)
            for joint in self.joints.values()
            for i in (0, 1)
        ]
        supply = self.supply.floor, self.supply.share, self.supply.zero
        return np.array([*rows, (*supply, *[0.0] * (len(NAMES) - len(supply)))])

    @property
    def trim(self) -> Array:
        """(c, TERMS) what is always off of the channels of `Sums`; see `trim`."""
        rows = [
            tuple(getattr(joint, name)[i] for name in TRIMMED)
            for joint in self.joints.values()
            for i in (0, 1)
        ]
        return np.array([*rows, (0.0,) * TERMS])


def unlearnt(joints: Sequence[str]) -> Tolerance:
    """Wide enough for a machine of which nothing was learnt."""
    one = JointTolerance(**{k: (v,) * 2 for k, v in zip(NAMES, UNLEARNT, strict=True)})
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
    rows, trim = _fitted(recordings)
    every = np.hstack([rows, trim]).tolist()
    names = tuple(JointTolerance.model_fields)
    pairs = {
        joint: JointTolerance(
            **{name: (every[2 * j][k], every[2 * j + 1][k]) for k, name in enumerate(names)}
        )
        for j, joint in enumerate(joints)
    }
    floor, share, zero = every[-1][:3]
    return Tolerance(
        provenance=provenance,
        joints=pairs,
        supply=SupplyTolerance(floor=floor, share=share, zero=zero),
        level=_level(recordings),
    )


def _fitted(recordings: Sequence[Sums]) -> tuple[Array, Array]:
    """(c, 6) tolerances that hold what was seen, and (c, TERMS) what is taken off before."""
    trim = fitted([(_blocks(one.residual), _blocks(one.trim)) for one in recordings])
    trim[-1] = 0.0  # that of the supply is identified
    left = [_trimmed(one, trim) for one in recordings]
    last = len(trim) - 1
    rows = [_row([one.channel(c) for one in left], supply=c == last) for c in range(last + 1)]
    return np.array(rows), trim


def _level(recordings: Sequence[Sums]) -> float:
    """The share of a tolerance that is taken once in APART, told from what each part of the
    recordings takes of tolerances that the others make; 1 at least. One for all channels: what is
    rare was seen on one joint, and comes to another.
    """
    parts = [part for one in recordings for part in _halves(one)]
    largest = []
    for k, held in enumerate(parts):
        rows, trim = _fitted([part for i, part in enumerate(parts) if i != k])
        share = taken(rows, _trimmed(held, trim)).max(axis=1)
        whole = len(share) // WINDOW
        largest.append(share[: whole * WINDOW].reshape(whole, WINDOW).max(axis=1))
    return max(level(np.concatenate(largest), APART * HOUR / (WINDOW * BLOCK)), 1.0)


def _halves(sums: Sums) -> tuple[Sums, Sums]:
    middle = len(sums.time) // 2
    later = [part[middle:] - part[middle - 1] for part in sums[1:]]
    return Sums(*(part[:middle] for part in sums)), Sums(sums.time[middle:], *later)


def _trimmed(sums: Sums, trim: Array) -> Sums:
    return sums._replace(residual=sums.residual - np.einsum("nck,ck->nc", sums.trim, trim))


def _blocks(sums: Array) -> Array:
    return np.diff(sums, axis=0, prepend=np.zeros_like(sums[:1]))


def _row(recordings: Sequence[Sums], supply: bool) -> tuple[float, ...]:
    """Floor, share, zero, creep, late and edge of a channel: of all that hold what was seen,
    those that allow least beside the least, in short and long spans alike.
    """
    of_supply = SUPPLY_FLOOR, SUPPLY_SHARE, SUPPLY_ZERO, 0.0, 0.0, 0.0
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
    """(n,) how far sums of one channel went in each `span`, and (n, 6) by what they may."""
    begin = np.arange(len(sums.time) - span)
    moved, by = grown(sums, begin, begin + span)
    return moved[:, 0], by[:, 0]
