"""Which fault it is: the signature that residuals follow best, from when, and how large.

The position is in what either chamber is compared with: an encoder moves both residuals of its
joint alike, whatever the pressures are. A transducer moves that of its own chamber, by the flow
that its pressure makes and by the oil that a jump of it seems to compress; that of the supply moves
the chamber that is fed, of all joints, and what the supply itself should be. A valve that does not
follow its command feeds both chambers less, and the supply droops less.

Sums of residuals are fitted, not the residuals: what encoders round and what jitters comes back in
the next block, and is not summed up. Every signature is tried from every onset that may have been.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.monitor.blocks import FlowBlock
from crane_observer.monitor.finding import COVERED, SUPPLY, Part, Wrong
from crane_observer.monitor.tolerance import History, within

PLAYS = 2.5e-4 * 1.5 ** np.arange(9)  # m at the piston
LAGS = 0.015 * 1.5 ** np.arange(10)  # s

ONSETS = 16  # that are tried at first, and between the best and its neighbours
BLOCKS_BEFORE = 40  # before the earliest onset, that say where residuals were
CORRELATED_BLOCKS = 10  # that err alike
FLOOR_SHARE = 0.25  # of a tolerance is one standard deviation
SIZE_STRETCH = 1.25  # times of which a fault still looks like that of a size which is tried
SIZE_SPREAD = 0.1  # of such a size is its standard deviation
STILL = 1e-5  # m of displacement in which an encoder that is stuck still flickers
DOUBTED = 1e-3  # m at the piston, from which on a position is in doubt

POSITIVE_KINDS = {Wrong.LEAKING}  # whose size is positive
KINDS_WITH_COURSE = {Wrong.SLOW, Wrong.LEAKING}
RELUCTANCE = {
    Wrong.STUCK: 0.7,
    Wrong.SWAPPED: 0.5,
    Wrong.OFFSET: 0.8,
    Wrong.LEAKING: 1.2,
    Wrong.OPEN: 1.3,
}
"""By which misfits are multiplied: of faults that explain as much, the plain ones come first."""
EXPLAINS = 0.1  # misfit of what explains all but noise
CLEARLY = 3.0  # times the misfit of the first suspect, beyond which another is excluded
VALVE_RESERVE = 0.5  # square standard deviations: an open valve explains any steady motion
COURSE_RESERVE = 0.05  # the same of a lag or a leak, whose course only the valve or piston has
FREE_RESERVE = {Part.VALVE: 2.5, Part.ENCODER: 5.0}  # the same, of what has no course of its own
WHOLE_MISFIT_SHARE = 0.6  # of the square residuals, at most left by what has no uncertain size
OUTDONE = 1.25  # times the misfit of another, at which that is named in the second look
DROOP_MISFIT = 0.5  # by which the supply discriminates an encoder from a valve


@dataclass(frozen=True)
class FaultSpan:
    """n blocks of j joints, as arrays, from when a fault may have begun."""

    duration: Array  # (n,) s
    since: Array  # (n,) s since it began, at the ends of the blocks
    encoder: Array  # (n, j)
    flow: Array  # (n, j, 2)
    crossed: Array
    fed: Array
    drop: Array
    softness: Array
    leak: Array
    known: Array  # (n, j, 2)
    last: Array
    stroke: Array  # (n, j)
    lever: Array
    feeding: Array  # (n,)

    @classmethod
    def of(cls, blocks: Sequence[FlowBlock]) -> "FaultSpan":
        def stacked(name: str) -> Array:
            return np.array([getattr(block, name) for block in blocks])

        begin, end = stacked("begin"), stacked("time")
        shared = {field.name: stacked(field.name) for field in fields(cls)[2:]}
        return cls(end - begin, end - begin[0], **shared)

    def went(self, j: int) -> Array:
        """(n,) m that piston j went, by the chambers of which it is known."""
        weight = np.where(self.known[:, j].any(axis=1, keepdims=True), self.known[:, j], True)
        return np.asarray((weight * self.flow[:, j]).sum(axis=1) / weight.sum(axis=1))


Moves = Callable[[FaultSpan, int], tuple[Array, Array]]
"""Residuals of joint j that a fault adds: (n, 2) of its chambers, and (n,) of the supply."""


class Signature(NamedTuple):
    """Addition of a fault to residuals, for a size of 1, or for the size `whole`."""

    part: Part
    kind: Wrong
    unit: str
    moves: Moves
    whole: float | None = None


def _encoder(error: Callable[[FaultSpan, int], Array]) -> Moves:
    """Signature of an encoder that is off by (n,) m in each block: both chambers show it."""
    return lambda span, j: (
        np.repeat(error(span, j)[:, None], 2, axis=1),
        np.zeros(len(span.since)),
    )


def _transducer(side: int, error: Callable[[FaultSpan, int], Array]) -> Moves:
    """Signature of a chamber, `error` (n,) Pa at the ends of blocks: by flow and compression."""

    def moves(span: FaultSpan, j: int) -> tuple[Array, Array]:
        shown = error(span, j)
        out = np.zeros((len(shown), 2))
        out[:, side] = span.drop[:, j, side] * shown
        out[:, side] += span.softness[:, j, side] * np.diff(shown, prepend=0.0)
        return out, np.zeros(len(shown))

    return moves


def _shown(side: int) -> Callable[[FaultSpan, int], Array]:
    """Pa that a transducer showed at the ends of blocks."""
    return lambda span, j: span.last[:, j, side]


def _exchanged(span: FaultSpan, j: int) -> tuple[Array, Array]:
    """Each chamber shows the pressure of the other."""
    return span.crossed[:, j] - span.flow[:, j], np.zeros(len(span.since))


def _slow(lag: float) -> Moves:
    """Signature of a valve whose flow follows by a first-order lag [s]; settled when it begins."""

    def moves(span: FaultSpan, j: int) -> tuple[Array, Array]:
        told = span.flow[:, j] / span.duration[:, None]
        shown, at = np.empty_like(told), told[0]
        for k, passed in enumerate(span.duration / lag):
            left = math.exp(-passed)
            shown[k] = told[k] + (1.0 - left) / passed * (at - told[k])  # in the mean of a block
            at = told[k] + left * (at - told[k])
        less = (told - shown) * span.duration[:, None]
        slower = less.mean(axis=1) * np.sign(span.went(j)) / span.duration
        return -less, span.stroke[:, j] * slower

    return moves


def _erratic(span: FaultSpan, j: int) -> Array:
    """m of an encoder that shows anything."""
    return np.asarray(span.encoder[:, j] - span.went(j))


def _free(span: FaultSpan, j: int) -> tuple[Array, Array]:
    """Signature of an arbitrary spool: the encoder is right, and the supply droops by that."""
    more = np.abs(span.encoder[:, j]) - np.abs(span.went(j))
    return _encoder(_erratic)(span, j)[0], -span.stroke[:, j] * more / span.duration


def _open(span: FaultSpan, j: int) -> tuple[Array, Array]:
    """Signature of a valve that always passes oil: the piston goes, and the supply droops."""
    return np.repeat(span.duration[:, None], 2, axis=1), -span.stroke[:, j]


def _backlash(play: float) -> Moves:
    """Signature of an encoder behind a play [m]: it trails the motion by half of it."""

    def error(span: FaultSpan, j: int) -> Array:
        true = np.cumsum(span.went(j))
        shown, at = np.empty_like(true), 0.0
        for k, x in enumerate(true):
            at = min(x + 0.5 * play, max(x - 0.5 * play, at))
            shown[k] = at
        return np.diff(shown - true, prepend=0.0)

    return _encoder(error)


def signatures() -> Iterator[Signature]:
    """Signatures of all faults in residuals, the first of equal ones; not jumps of encoders."""
    encoder, valve = Part.ENCODER, Part.VALVE
    drift = _encoder(lambda s, j: s.duration * s.lever[:, j] / s.lever[0, j])
    yield Signature(encoder, Wrong.STUCK, "", _encoder(lambda s, j: -s.went(j)), whole=1.0)
    yield Signature(encoder, Wrong.DRIFT, "m/s", drift)
    yield Signature(encoder, Wrong.SCALE, "1", _encoder(lambda s, j: s.went(j)))
    for play in PLAYS.tolist():
        yield Signature(encoder, Wrong.BACKLASH, "m", _backlash(play), whole=play)
    yield Signature(encoder, Wrong.ERRATIC, "", _encoder(_erratic), whole=1.0)
    for side, part in enumerate((Part.PRESSURE_A, Part.PRESSURE_B)):
        offset = _transducer(side, lambda s, _: np.ones_like(s.since))
        gain = _transducer(side, _shown(side))
        yield Signature(part, Wrong.OFFSET, "Pa", offset)
        yield Signature(part, Wrong.DRIFT, "Pa/s", _transducer(side, lambda s, _: s.since))
        yield Signature(part, Wrong.GAIN, "1", gain)
    yield Signature(Part.PRESSURES, Wrong.SWAPPED, "", _exchanged, whole=1.0)
    yield Signature(valve, Wrong.STUCK, "", _free, whole=1.0)
    for lag in LAGS.tolist():
        yield Signature(valve, Wrong.SLOW, "s", _slow(lag), whole=lag)
    leak: Moves = lambda s, j: (s.leak[:, j], np.zeros(len(s.since)))  # noqa: E731
    yield Signature(valve, Wrong.LEAKING, "m3/(s Pa)", leak)
    yield Signature(valve, Wrong.OPEN, "m/s", _open)


class Suspect(NamedTuple):
    """A fault that explains the residuals: how badly, from when [s], and how large."""

    part: Part
    joint: str  # or "supply"
    kind: Wrong
    misfit: float  # mean square in standard deviations
    onset: float  # s
    size: float
    deviation: float
    unit: str
    error: float  # m at the piston, by which an encoder would be off by now; 0 of others

    @property
    def certain(self) -> bool:
        """Return whether its size is surely not 0; a fault without size is certain."""
        return abs(self.size) > COVERED * self.deviation

    @property
    def free(self) -> bool:
        """Return whether it has no course of its own, so that only the supply discriminates it."""
        return (self.part, self.kind) in ((Part.VALVE, Wrong.STUCK), (Part.ENCODER, Wrong.ERRATIC))

    @property
    def badness(self) -> float:
        """Its misfit, and by how much plainer faults are preferred."""
        reserve = VALVE_RESERVE if self.part is Part.VALVE else 0.0
        if self.kind in KINDS_WITH_COURSE:
            reserve = COURSE_RESERVE
        elif self.free:
            reserve = FREE_RESERVE[self.part]
        return (self.misfit + reserve) * RELUCTANCE.get(self.kind, 1.0)


@dataclass(frozen=True)
class Alarm:
    """Observations when channels took all of their tolerance."""

    history: History
    tolerance: Array  # (c, 6)
    joints: Sequence[str]
    alarmed: Array  # (c,) which channels
    watched: Flags  # (c,) by which the fault is isolated
    span: int  # blocks, over which it took its tolerance
    ago: int  # blocks before the newest


def isolate(alarm: Alarm) -> list[Suspect]:
    """Suspects, the first first."""
    history = alarm.history
    newest, since = history.newest, history.since_row[alarm.watched].max(initial=0)
    oldest = max(newest - 2 * alarm.span - BLOCKS_BEFORE, int(since))
    most = max(newest - oldest - 5, 1)
    least = min(alarm.ago + 1, most)  # what alarms has begun
    spread = np.round(np.geomspace(least, most, ONSETS)).astype(int)
    backs = np.unique(np.clip([*spread, *(least + np.arange(5))], least, most))
    found = {back: _tried(alarm, oldest, back) for back in backs}
    if not any(found.values()):
        return []
    best = min((suspects[0].badness, back) for back, suspects in found.items() if suspects)[1]
    place = int(np.searchsorted(backs, best))
    low, high = backs[max(place - 1, 0)], backs[min(place + 1, len(backs) - 1)]
    for back in range(low + 1, high, max((high - low) // ONSETS, 1)):
        if back not in found:
            found[back] = _tried(alarm, oldest, back)
    every_suspect = (suspect for suspects in found.values() for suspect in suspects)
    return sorted(every_suspect, key=lambda suspect: suspect.badness)


def encoder_behind(suspects: Sequence[Suspect]) -> Suspect | None:
    """The encoder that may be faulty instead of what is named: one that explains the residuals not
    clearly worse than any suspect does. Few blocks behind an onset discriminate little, and if an
    encoder is faulty, it is not known where the crane is.
    """
    encoders = [s for s in suspects if s.part is Part.ENCODER and s.certain]
    if not encoders:
        return None
    if _supply_says(suspects, best_of(suspects, Part.ENCODER).joint) is Part.VALVE:
        return None
    most = CLEARLY * max(min(suspect.misfit for suspect in suspects), EXPLAINS)
    # a fault that stands while oil flows needs no size that fits
    return min(
        (encoder for encoder in encoders if encoder.misfit <= most),
        key=lambda encoder: (encoder.kind is not Wrong.STUCK, encoder.misfit),
        default=None,
    )


def best_of(suspects: Sequence[Suspect], part: Part) -> Suspect:
    """The first suspect of a part that has one."""
    return next(suspect for suspect in suspects if suspect.part is part)


def named(suspects: Sequence[Suspect]) -> Suspect:
    """The first suspect, unless that is an encoder or a valve and the supply says the other."""
    first = suspects[0]
    says = _supply_says(suspects, first.joint)
    return best_of(suspects, says) if says and first.part in (Part.ENCODER, Part.VALVE) else first


def outdone(suspect: Suspect, rival: Suspect) -> bool:
    """Return whether the rival explains the residuals better, and not by chance."""
    return suspect.badness > OUTDONE * max(rival.badness, EXPLAINS)


def _supply_says(suspects: Sequence[Suspect], joint: str) -> Part | None:
    """Return whether a piston followed its encoder, not its commands; None if not clear."""
    least: dict[Part, float] = {}
    for suspect in suspects:
        if suspect.free and suspect.joint == joint:
            least[suspect.part] = min(suspect.misfit, least.get(suspect.part, math.inf))
    if len(least) < 2:
        return None
    more = least[Part.ENCODER] - least[Part.VALVE]
    if abs(more) < DROOP_MISFIT:
        return None
    return Part.VALVE if more > 0.0 else Part.ENCODER


def _tried(alarm: Alarm, oldest: int, back: int) -> list[Suspect]:
    """All that may have begun `back` blocks ago, by their misfit since the row `oldest`."""
    history, watched, sums = alarm.history, alarm.watched, alarm.history.sums
    row = history.newest - int(back)
    blocks = history.since(row)
    span = FaultSpan.of(blocks)
    at = np.arange(oldest, history.newest + 1)
    base = sums.residual[max(row - 4, oldest) : row + 1].mean(axis=0)
    tolerance = alarm.tolerance[:, :4]  # stamps that are off delay an alarm, and give it no shape
    deviation = FLOOR_SHARE * within(tolerance, sums, np.full(len(at), row), at)
    data = np.where(watched, (sums.residual[at] - base) / deviation, 0.0)
    found, unexplained = [], float(np.mean(data**2))
    for part, joint, kind, unit, whole, shape in _shapes(span, alarm):
        model = np.zeros_like(data)
        model[row - oldest + 1 :] = np.cumsum(shape, axis=0)
        model = np.where(watched, model / deviation, 0.0)
        if not model.any():
            continue
        first, begun = np.zeros_like(data), row - oldest + 1
        first[begun:] = shape[0]
        model -= _before(data, model, np.where(watched, first / deviation, 0.0), whole)
        power = float(np.sum(model**2))
        if power == 0.0:
            continue
        times = float(np.sum(model * data)) / power
        if whole:
            times = min(max(times, 1.0 / SIZE_STRETCH), SIZE_STRETCH) if unit else 1.0
        if times < 0.0 and kind in POSITIVE_KINDS:
            continue
        misfit = float(np.mean((data - times * model) ** 2))
        spread = math.sqrt(CORRELATED_BLOCKS * max(misfit, 1.0) / power)
        if whole and misfit > WHOLE_MISFIT_SHARE * unexplained:
            continue
        if whole:
            spread = SIZE_SPREAD * whole if unit else 0.0
        size, error = (whole or 1.0) * times, 0.0
        if part is Part.ENCODER:
            column = 2 * alarm.joints.index(joint)
            off = np.abs(np.cumsum(shape[:, column : column + 2], axis=0)).max()
            error = abs(times) * float(off)
        onset = blocks[0].begin
        found.append(Suspect(part, joint, kind, misfit, onset, size, spread, unit, error))
    return sorted(found, key=lambda suspect: suspect.badness)


def _before(data: Array, model: Array, first: Array, whole: float | None) -> Array:
    """Excess of a model (n, c) because the fault began within the block `first` (n, c)."""
    power = float(np.sum(first**2))
    if power == 0.0:
        return first
    if whole:
        share = -float(np.sum((data - model) * first)) / power
    else:  # data = times model - more first
        columns = np.stack([model.ravel(), first.ravel()], axis=1)
        (times, more), *_ = np.linalg.lstsq(columns, data.ravel(), rcond=None)
        share = -more / times if times else 0.0
    return min(max(float(share), 0.0), 1.0) * first


class FaultShape(NamedTuple):
    """A fault that can have been, and what it adds (n, c) to the residuals of n blocks."""

    part: Part
    joint: str
    kind: Wrong
    unit: str
    whole: float | None
    shape: Array


def _shapes(span: FaultSpan, alarm: Alarm) -> Iterator[FaultShape]:
    n, count = len(span.since), 2 * len(alarm.joints) + 1
    known = span.known.reshape(n, -1)
    begun = min(n - 1, 1)  # an encoder may have moved before, in the first block
    for j in np.flatnonzero(alarm.alarmed[:-1].reshape(-1, 2).any(axis=1)).tolist():
        still = float(np.abs(span.encoder[begun:, j]).sum()) < STILL
        for part, kind, unit, moves, whole in signatures():
            if part is Part.ENCODER and still != (kind is Wrong.STUCK):
                continue
            shape = np.zeros((n, count))
            shape[:, 2 * j : 2 * j + 2], shape[:, -1] = moves(span, j)
            shape[:, :-1] *= known
            shape[:, -1] *= span.feeding
            yield FaultShape(part, alarm.joints[j], kind, unit, whole, shape)
    for kind, unit, error in ((Wrong.OFFSET, "Pa", np.ones(n)), (Wrong.DRIFT, "Pa/s", span.since)):
        shape = np.zeros((n, count))
        shape[:, :-1] = (span.fed * error[:, None, None]).reshape(n, -1) * known
        shape[:, -1] = error * span.feeding
        yield FaultShape(Part.SUPPLY, SUPPLY, kind, unit, None, shape)
