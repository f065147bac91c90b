"""Sums of residuals, and how far they go if no sensor is faulty, learnt from such recordings.

What the model is off by on a machine, always and alike, is taken off first (`trim`). A transducer
whose zero is off makes a flow that follows the slope of the valve's edge at the pressures of the
moment, so it shows most where an edge has next to no pressure left; what the identification made of
it is an error of the gains, up and down. A dead band that is off makes the slowest motions err
most, and oil that is softer each change of pressure. A valve that follows its command later or
sooner than the model says errs with each change of its opening; of a joint that hunts, all that
adds up. A leak that is not that of the model creeps while the joint stands. In a block

    r = zero S + up X + down X' + wider N - wider' N' + softer C + late W + leak Y

with S what a transducer adds that is 1 Pa off, X and X' the displacement of the piston that extends
and retracts, N and N' what an opening wider by the whole stroke adds on it, C oil that is twice as
soft, W a spool that moves 1 s later, and Y a leak of 1 m3/(s Pa) past the piston. What changes with
the time of day stays in the residuals, and in their tolerance: between any two blocks the sum of
the rest stays within

    floor + share P + zero S + creep T + late V + edge E

with P the path of the piston between them, S what a transducer that is 1 Pa off adds on this path,
T the time, V all changes of its speed between them, up and down alike, and E what it would go by
edges of the valve that are open by all their play, while it stands where they may be open or shut;
for the supply, P is the droop of all flow, S the number of blocks, and there is no V and no E.
`floor` is what noise and rounding do, however long the path; `share` an error of gains, `zero` one
of the zeros, `creep` one of leakage; `late` is how long after its stamp a command reaches the
valve, and how far stamps of readings are off, more than the model knows: of a joint that hunts,
each reversal adds to it; `edge` is the share of its play by which a valve may stand elsewhere than
is thought: it passes oil, or does not, for as long as the joint is held.

The largest share of its tolerance over all windows that end now is a test for a change of the mean
that began at any time within them (a window-limited generalized likelihood ratio). An alarm takes
more of it than `level`, which a machine without a fault takes once in HOURS_PER_FALSE_ALARM.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array, Flags
from crane_model.configuration import NonNegative, Positive, Schema
from crane_model.errors import DataError
from crane_observer.monitor.blocks import BLOCK, FlowBlock

TRIM_SPAN = 20  # blocks, over which what encoders round hardly counts
TRIM_EXPECTED = np.array([1e5, 0.02, 0.02, 2e-4, 2e-4, 0.05, 5e-3, 1e-13])
"""Standard deviations of zero [Pa], up, down, dead bands [of the stroke], softer, late [s] and leak
[m3/(s Pa)]."""
TERMS = len(TRIM_EXPECTED)
TRIM_OUTLYING = 3.0  # times the usual residual, beyond which a span counts less
TRIM_ROUNDS = 3  # of the fit, each beside what the last one left

KEPT_BLOCKS = 1200  # a minute
SUM_SPANS = 2 ** np.arange(11)  # blocks, over which sums are looked at: from 0.05 to 51 s

HIGH_SHARE = 0.2  # of the windows that is called high
FEWEST_HIGH = 10  # windows that tell a mean excess
RESERVE = 1.5  # over the largest that was ever seen
LEAST = 4e-5, 1e-3, 1e4, 1e-6, 5e-4, 0.2  # m, of the path, Pa, m/s, s, of the play: at least
LEAST_SUPPLY = 1.5e5, 0.02, 2e3, 0.0, 0.0, 0.0  # Pa, of the droop, Pa: at least
UNLEARNT = 2.4e-4, 6e-3, 6e4, 6e-6, 1.2e-2, 1.0  # the same, of a machine that is not learnt
UNLEARNT_SUPPLY = 20.0  # times the least of the supply, of such a machine
HOURS_PER_FALSE_ALARM = 10.0
WINDOW_BLOCKS = 200  # of which the largest counts as one: longer than residuals err alike

Rows = NDArray[np.int64]


class Sums(NamedTuple):
    """Sums until the ends of n blocks; c channels: A and B of each joint, and the supply."""

    time: Array  # (n,) s
    residual: Array  # (n, c) m, for the supply Pa
    path: Array  # (n, c) m that the piston has gone, for the supply Pa of droop
    drop: Array  # (n, c) m/Pa of a transducer off by 1 Pa, for the supply the count of blocks
    turned: Array  # (n, c) m/s by which the speed of the piston changed, up and down alike
    edge: Array  # (n, c) m that the piston goes by edges which may be open, or not
    trim: Array  # (n, c, TERMS) the regressors of what is learnt to be always off

    @classmethod
    def zeros(cls, rows: int, channels: int) -> "Sums":
        residual, path, drop, turned, edge = np.zeros((5, rows, channels))
        trim = np.zeros((rows, channels, TERMS))
        return cls(np.zeros(rows), residual, path, drop, turned, edge, trim)

    def channel(self, c: int) -> "Sums":
        return Sums(self.time, *(part[:, c : c + 1] for part in self[1:]))


class Added(NamedTuple):
    """Addition of a block to `Sums`, except for the time."""

    residual: Array  # (c,)
    path: Array  # (c,)
    drop: Array  # (c,)
    turned: Array  # (c,)
    edge: Array  # (c,)
    trim: Array  # (c, TERMS)


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


def of_block(block: FlowBlock, trusted: Flags | None = None) -> Added:
    """Nothing where the flow is not known, nor of the supply where it feeds a chamber of which the
    transducer is not one of those `trusted` (j, 2), by default all.
    """
    known = block.known.ravel()
    feeding = block.feeding and (trusted is None or bool(trusted[block.fed != 0.0].all()))

    def of_known(values: Array) -> Array:
        return np.where(known, values.ravel(), 0.0)

    moved = np.maximum(
        np.abs(block.encoder), np.where(block.known, np.abs(block.flow), 0.0).max(axis=1)
    )
    pressed = of_known(block.drop)
    course = np.repeat(block.encoder, 2)
    rest = (course, block.null, block.squeezed, block.late, block.leak)
    trim = np.zeros((len(known) + 1, TERMS))
    trim[:-1] = regressors(pressed, *map(of_known, rest))
    return Added(
        np.append(of_known(block.encoder[:, None] - block.flow), block.supply if feeding else 0.0),
        np.append(of_known(np.repeat(moved, 2)), block.drawn.sum()),
        np.append(np.abs(pressed), float(feeding)),
        np.append(of_known(block.turned), 0.0),
        np.append(of_known(block.edge), 0.0),
        trim,
    )


def summed(times: Sequence[float], added: Sequence[Added]) -> Sums:
    """Sums of all blocks of a recording."""
    return Sums(np.array(times), *(np.cumsum(part, axis=0) for part in zip(*added, strict=True)))


class History:
    """The last blocks, and their sums; the row of the newest is `newest`."""

    def __init__(self, trim: Array):
        """`trim` (c, TERMS): what is taken off the residuals, learnt of this machine."""
        self._trim = trim
        self.sums = Sums.zeros(2 * KEPT_BLOCKS, len(trim))  # rows up to `newest` hold
        self._blocks: list[FlowBlock] = []
        self.newest = -1
        self.since_row = np.zeros(len(trim), dtype=np.int64)  # (c,) no sum begins before it

    def add(self, block: FlowBlock, trusted: Flags) -> None:
        """Add a block and forget the oldest; (c,) transducers are `trusted`."""
        if not trusted[-1]:
            block = block._replace(known=block.known & (block.fed == 0.0))
        if self.newest + 1 == 2 * KEPT_BLOCKS:
            for array in self.sums:
                array[:KEPT_BLOCKS] = array[KEPT_BLOCKS:]
            self._blocks = self._blocks[KEPT_BLOCKS:]
            self.newest -= KEPT_BLOCKS
            self.since_row = np.maximum(self.since_row - KEPT_BLOCKS, 0)
        before = self.newest
        self.newest += 1
        self._blocks.append(block)
        self.sums.time[self.newest] = block.time
        added = of_block(block, trusted[:-1].reshape(-1, 2))
        left = added.residual - np.einsum("ck,ck->c", added.trim, self._trim)
        for array, more in zip(self.sums[1:], added._replace(residual=left), strict=True):
            array[self.newest] = more if before < 0 else array[before] + more

    def forget(self, channels: slice) -> None:
        """Let the sums of channels begin with the next block."""
        self.since_row[channels] = self.newest

    def since(self, row: int) -> Sequence[FlowBlock]:
        return self._blocks[row + 1 : self.newest + 1]

    def known_since(self, onset: float) -> Flags:
        """(j, 2) chambers whose flow was known in every block since `onset` [s]."""
        joints = len(self.since_row) // 2
        known = [block.known for block in self._blocks[: self.newest + 1] if block.begin >= onset]
        return np.all(np.reshape(known, (-1, joints, 2)), axis=0)


def between(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) growth of sums between rows (n,), and its limits by tolerances (c, 6) or (6,)."""
    moved, by = grown(sums, begin, end)
    return moved, np.asarray((by * tolerance).sum(axis=-1))


def grown(sums: Sums, begin: Rows, end: Rows) -> tuple[Array, Array]:
    """(n, c) growth of sums between rows (n,), and (n, c, 6) the factors of tolerances."""

    def change(array: Array) -> Array:
        return np.abs(array[end] - array[begin])

    ones = np.ones_like(sums.path[end])
    lasting = BLOCK * np.abs(end - begin)[:, None] * ones
    by = [ones, change(sums.path), change(sums.drop), lasting, change(sums.turned)]
    return change(sums.residual), np.stack([*by, change(sums.edge)], axis=-1)


def within(tolerance: Array, sums: Sums, begin: Rows, end: Rows) -> Array:
    """(n, c) how far they may if stamps and spools are right, by tolerances (c, 4) of the rest."""
    _, by = grown(sums, begin, end)
    floor, share, zero, creep = tolerance.T
    return np.asarray(floor + share * by[..., 1] + zero * by[..., 2] + creep * by[..., 3])


def excess(tolerance: Array, history: History) -> tuple[Array, Array]:
    """(c,) largest share of each tolerance taken by the newest sum, and over how many blocks."""
    sums, now = history.sums, history.newest
    spans = SUM_SPANS[now >= SUM_SPANS]
    if not len(spans):
        return np.zeros(len(tolerance)), np.ones(len(tolerance), dtype=int)
    moved, may = between(tolerance, sums, now - spans, np.full(len(spans), now))
    begun = (now - spans)[:, None] >= history.since_row
    shares = np.where(begun, moved / may, 0.0)
    worst = shares.argmax(axis=0)
    return shares[worst, np.arange(len(tolerance))], spans[worst]


def taken(tolerance: Array, sums: Sums) -> Array:
    """(n, c) the same share at each block of a recording."""
    most = np.zeros_like(sums.residual)
    for span in SUM_SPANS[len(sums.time) > SUM_SPANS]:
        begin = np.arange(len(sums.time) - span)
        moved, may = between(tolerance, sums, begin, begin + span)
        most[span:] = np.maximum(most[span:], moved / may)
    return most


class JointTolerance(Schema):
    """Tolerances of both chambers of a joint, A and B, and the values subtracted before."""

    floor: tuple[Positive, Positive]  # m
    share: tuple[NonNegative, NonNegative]  # of the path
    zero: tuple[NonNegative, NonNegative]  # Pa
    creep: tuple[NonNegative, NonNegative]  # m/s
    late: tuple[NonNegative, NonNegative]  # s
    edge: tuple[NonNegative, NonNegative] = LEAST[-1], LEAST[-1]  # of the play
    off: tuple[float, float] = (0.0, 0.0)  # Pa, always, as gains are:
    up: tuple[float, float] = (0.0, 0.0)  # of the displacement of a cylinder that extends
    down: tuple[float, float] = (0.0, 0.0)  # and of one that retracts
    wider_up: tuple[float, float] = (0.0, 0.0)  # of the stroke that a valve opens more, extending
    wider_down: tuple[float, float] = (0.0, 0.0)  # and retracting
    softer: tuple[float, float] = (0.0, 0.0)  # of what the oil gives way, that it gives more
    later: tuple[float, float] = (0.0, 0.0)  # s that the valve follows later than the model says
    leak: tuple[float, float] = (0.0, 0.0)  # m3/(s Pa) past the piston, more than the model says


FIELDS = tuple(JointTolerance.model_fields)
TOLERANCE_FIELDS, TRIM_FIELDS = FIELDS[: len(LEAST)], FIELDS[len(LEAST) :]


class SupplyTolerance(Schema):
    """Tolerance of the supply."""

    floor: Positive  # Pa, summed over blocks
    share: NonNegative  # of the droop
    zero: NonNegative  # Pa


class Tolerance(Schema):
    """Tolerances of a machine on the day of the recordings that they were learnt from."""

    provenance: str
    joints: dict[str, JointTolerance]
    supply: SupplyTolerance
    level: Positive = 1.0  # share of a tolerance, of which an alarm takes more

    @property
    def rows(self) -> Array:
        """(c, 6) floor, share, zero, creep, late and edge of the channels of `Sums`."""
        supply = self.supply
        return self._channels(
            TOLERANCE_FIELDS, (supply.floor, supply.share, supply.zero, 0.0, 0.0, 0.0)
        )

    @property
    def trim(self) -> Array:
        """(c, TERMS) what is always off of the channels of `Sums`."""
        return self._channels(TRIM_FIELDS, (0.0,) * TERMS)

    def _channels(self, names: Sequence[str], supply: tuple[float, ...]) -> Array:
        rows = [
            tuple(getattr(joint, name)[chamber] for name in names)
            for joint in self.joints.values()
            for chamber in (0, 1)
        ]
        return np.array([*rows, supply])


def unlearnt(joints: Sequence[str]) -> Tolerance:
    """Return a tolerance that is wide enough for a machine of which nothing was learnt.

    Parameters
    ----------
    joints
        Names of its joints, from the base to the tip.

    Returns
    -------
    Tolerance
        The same for each joint.
    """
    fields = zip(TOLERANCE_FIELDS, UNLEARNT, strict=True)
    joint_tolerance = JointTolerance(**{name: (value, value) for name, value in fields})
    floor, share, zero = (UNLEARNT_SUPPLY * value for value in LEAST_SUPPLY[:3])
    return Tolerance(
        provenance="assumed: nothing was learnt of this machine",
        joints=dict.fromkeys(joints, joint_tolerance),
        supply=SupplyTolerance(floor=floor, share=share, zero=zero),
    )


def learn(joints: Sequence[str], recordings: Sequence[Sums], provenance: str) -> Tolerance:
    """Learn the tolerance of a machine from recordings without a fault.

    Parameters
    ----------
    joints
        Names of its joints, from the base to the tip.
    recordings
        Sums of the residuals of each recording, of `SensorWatch`.
    provenance
        From what it is learnt, in words.

    Returns
    -------
    Tolerance
        Holds whatever was seen, with a reserve, and allows as little beside it as possible.

    Raises
    ------
    DataError
        There is less than a minute of recording.
    """
    if sum(len(sums.residual) for sums in recordings) < KEPT_BLOCKS:
        raise DataError(
            "tolerances: less than a minute of recording; learn them from the recordings that the "
            "model was identified from, and from work"
        )
    rows, trim = _fitted(recordings)
    columns = np.hstack([rows, trim]).tolist()
    pairs = {
        joint: JointTolerance(
            **{name: (columns[2 * j][k], columns[2 * j + 1][k]) for k, name in enumerate(FIELDS)}
        )
        for j, joint in enumerate(joints)
    }
    floor, share, zero = columns[-1][:3]
    return Tolerance(
        provenance=provenance,
        joints=pairs,
        supply=SupplyTolerance(floor=floor, share=share, zero=zero),
        level=_level(recordings),
    )


def level(largest: Array, windows: float) -> float:
    """Level that a statistic exceeds once in `windows`, from the largest (n,) in each of n.

    Values above a high threshold u are distributed exponentially beyond it (the generalized Pareto
    law of shape 0, to which the maxima of most distributions come: Pickands 1975). Its mean is told
    by the mean excess m of k windows alone: of another window, the excess is beyond x by
    (1 + x/(k m))^-k, the predictive distribution with the prior that no scale is preferred. So once
    in N windows it exceeds u + k m ((N s)^(1/k) - 1), with s the share of windows above u: from
    few windows the level is high, from many it falls to u + m log(N s). `ValueError` if no level
    exists.
    """
    if len(largest) < 2:
        raise ValueError(
            f"level: {len(largest)} windows to determine it from; at least two are needed"
        )
    high = min(max(round(HIGH_SHARE * len(largest)), FEWEST_HIGH), len(largest) - 1)
    ordered = np.sort(largest)
    above, threshold = ordered[-high:], ordered[-high - 1]
    rate = high / len(largest)
    times = high * math.expm1(max(math.log(windows * rate), 0.0) / high)
    return float(threshold + np.mean(above - threshold) * times)


def _level(recordings: Sequence[Sums]) -> float:
    """The share of a tolerance that is taken once in HOURS_PER_FALSE_ALARM, told from what each
    part of the recordings takes of tolerances that the others make; 1 at least. The same for all
    channels: what is rare was seen on one joint, and comes to another.
    """
    parts = [part for sums in recordings for part in _halves(sums)]
    largest = []
    for k, held in enumerate(parts):
        rows, trim = _fitted([part for i, part in enumerate(parts) if i != k])
        share = taken(rows, _trimmed(held, trim)).max(axis=1)
        whole = len(share) // WINDOW_BLOCKS
        windows = share[: whole * WINDOW_BLOCKS].reshape(whole, WINDOW_BLOCKS)
        largest.append(windows.max(axis=1))
    apart = HOURS_PER_FALSE_ALARM * 3600.0 / (WINDOW_BLOCKS * BLOCK)
    return max(level(np.concatenate(largest), apart), 1.0)


def _halves(sums: Sums) -> tuple[Sums, Sums]:
    middle = len(sums.time) // 2
    later = [part[middle:] - part[middle - 1] for part in sums[1:]]
    return Sums(*(part[:middle] for part in sums)), Sums(sums.time[middle:], *later)


def _trimmed(sums: Sums, trim: Array) -> Sums:
    return sums._replace(residual=sums.residual - np.einsum("nck,ck->nc", sums.trim, trim))


def _fitted(recordings: Sequence[Sums]) -> tuple[Array, Array]:
    """(c, 6) tolerances that hold what was seen, and (c, TERMS) what is taken off before."""

    def blocks(sums: Array) -> Array:
        return np.diff(sums, axis=0, prepend=np.zeros_like(sums[:1]))

    trim = fitted([(blocks(sums.residual), blocks(sums.trim)) for sums in recordings])
    trim[-1] = 0.0  # that of the supply is identified
    left = [_trimmed(sums, trim) for sums in recordings]
    last = len(trim) - 1
    rows = [
        _row([sums.channel(c) for sums in left], LEAST_SUPPLY if c == last else LEAST)
        for c in range(last + 1)
    ]
    return np.array(rows), trim


def fitted(recordings: Sequence[tuple[Array, Array]]) -> Array:
    """(c, TERMS) from residuals (n, c) of blocks and their regressors (n, c, TERMS)."""
    residual = np.concatenate([_spans(blocks) for blocks, _ in recordings])
    columns = np.concatenate([_spans(blocks) for _, blocks in recordings])
    return np.array(
        [_robust(residual[:, c], columns[:, c]) for c in range(residual.shape[1])]
    ).reshape(-1, TERMS)


def _spans(blocks: Array) -> Array:
    whole = len(blocks) // TRIM_SPAN
    return blocks[: whole * TRIM_SPAN].reshape(whole, TRIM_SPAN, *blocks.shape[1:]).sum(axis=1)


def _robust(residual: Array, columns: Array) -> Array:
    """(TERMS,) by Huber's loss, with what is to be expected as measurements."""
    moving = np.any(columns != 0.0, axis=1)
    columns, residual = columns[moving] * TRIM_EXPECTED, residual[moving]
    share = np.zeros(TERMS)
    from scipy.optimize import least_squares  # half a second to import

    for _ in range(TRIM_ROUNDS):
        usual = float(np.median(np.abs(residual - columns @ share))) if len(residual) else 0.0
        if usual == 0.0:
            break
        weighted, target = columns / usual, residual / usual

        def left(x: Array, columns: Array = weighted, target: Array = target) -> Array:
            return np.concatenate([columns @ x - target, x])

        share = least_squares(left, share, loss="huber", f_scale=TRIM_OUTLYING).x
    return np.asarray(share * TRIM_EXPECTED)


def _row(recordings: Sequence[Sums], at_least: tuple[float, ...]) -> tuple[float, ...]:
    """Tolerances (6,) of a channel that hold all that was seen and allow least."""
    least = np.array(at_least)
    cost, beyond, asked = np.zeros(len(least)), [], []
    for span in SUM_SPANS.tolist():
        seen = []
        for sums in recordings:
            if len(sums.time) > span:
                begin = np.arange(len(sums.time) - span)
                moved, by = grown(sums, begin, begin + span)
                seen.append((moved[:, 0], by[:, 0]))
        if not seen:
            continue
        moved, by = (np.concatenate(part) for part in zip(*seen, strict=True))
        usual = by.mean(axis=0)
        cost += usual / float(usual @ least)
        over = RESERVE * moved > by @ least
        beyond.append(by[over] * least)
        asked.append(RESERVE * moved[over])
    rows, wanted = np.concatenate(beyond), np.concatenate(asked)
    if not len(rows):
        return tuple(least.tolist())
    from scipy.optimize import linprog

    size = wanted[:, None]  # so that small and large count alike within the solver's tolerance
    found = linprog(
        cost * least, -rows / size, -np.ones(len(rows)), bounds=[(1.0, None)] * len(least)
    )
    if found.status != 0:
        raise DataError(f"tolerances: none holds what was seen: {found.message}")
    return tuple((found.x * least).tolist())
