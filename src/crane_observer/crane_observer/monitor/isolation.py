"""Whose fault it is: the signature that residuals follow best, from when, and how large.

Sums of residuals are fitted, not the residuals: what encoders round and what jitters comes back in
the next block, and is not summed up. Every signature is tried from every onset that may have been.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.monitor.history import History, within
from crane_observer.monitor.signatures import COVERED, SUPPLY, FaultSpan, Part, Wrong, signatures

ONSETS = 16  # that are tried at first, and between the best and its neighbours
BEFORE = 40  # blocks before the earliest onset that say where residuals were
CORRELATED = 10  # blocks that err alike
FLOOR_SHARE = 0.25  # of a tolerance is one standard deviation
ONE_WAY = {Wrong.LEAKING}  # whose size is positive
HAVE_A_COURSE = {Wrong.SLOW, Wrong.LEAKING}
RELUCTANCE = {
    Wrong.STUCK: 0.7,
    Wrong.SWAPPED: 0.5,
    Wrong.OFFSET: 0.8,
    Wrong.LEAKING: 1.2,
    Wrong.OPEN: 1.3,
}
"""By which misfits are multiplied: of faults that explain as much, the plain ones come first."""
STRETCH = 1.25  # times of which a fault still looks like that of a size which is tried
DOUBTED = 1e-3  # m at the piston, from which on a position is in doubt
BETWEEN = 0.1  # of such a size is its standard deviation
QUIET = 1e-5  # m of way in which an encoder that is stuck still flickers

EXPLAINS = 0.1  # misfit of what explains all but noise
CLEARLY = 3.0  # times the misfit of the first suspect, beyond which another is excluded
VALVE_RESERVE = 0.5  # square standard deviations: an open valve explains any steady motion
COURSE_RESERVE = 0.05  # the same of a lag or a leak, whose course only the valve or piston has
EXPLAINED_BY_WHOLE = (
    0.6  # of the square residuals, at most left by what has no size to be uncertain
)
BETTER = 1.25  # times the misfit of another, at which that is named in the second look
DROOPS = 0.5  # misfit by which the supply tells an encoder from a valve
ANYTHING_RESERVE = {
    Part.VALVE: 2.5,
    Part.ENCODER: 5.0,
}  # the same, of what has no course of its own


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
        """Whether its size is surely not 0; what has no size is."""
        return abs(self.size) > COVERED * self.deviation


def isolate(
    history: History,
    tolerance: Array,
    joints: Sequence[str],
    alarmed: Array,
    watched: Flags,
    span: int,
    ago: int,
) -> list[Suspect]:
    """Suspects, the first first, after channels `alarmed` (c,) took all of their tolerance over
    `span` blocks, `ago` blocks before the newest; by those `watched` (c,).
    """
    tolerance = tolerance[:, :4]  # stamps that are off delay an alarm, and give it no shape
    newest = history.newest
    oldest = max(newest - 2 * span - BEFORE, int(history.since_row[watched].max(initial=0)))
    most = max(newest - oldest - 5, 1)
    least = min(ago + 1, most)  # what alarms has begun
    spread = np.round(np.geomspace(least, most, ONSETS)).astype(int)
    backs = np.unique(np.clip([*spread, *(least + np.arange(5))], least, most))
    found = {
        back: _tried(history, tolerance, joints, alarmed, watched, oldest, back) for back in backs
    }
    if not any(found.values()):
        return []
    best = min((_badness(one[0]), back) for back, one in found.items() if one)[1]
    place = int(np.searchsorted(backs, best))
    low, high = backs[max(place - 1, 0)], backs[min(place + 1, len(backs) - 1)]
    for back in range(low + 1, high, max((high - low) // ONSETS, 1)):
        if back not in found:
            found[back] = _tried(history, tolerance, joints, alarmed, watched, oldest, back)
    return sorted((one for some in found.values() for one in some), key=_badness)


def encoder_behind(suspects: Sequence[Suspect]) -> Suspect | None:
    """The encoder that may lie instead of what is named: one that explains the residuals not
    clearly worse than any suspect does. Few blocks behind an onset tell little apart, and who moves
    a crane by an encoder that lies does not know where it is.
    """
    encoders = [one for one in suspects if one.part is Part.ENCODER and one.certain]
    if not encoders:
        return None
    if _supply_says(suspects, best_of(suspects, Part.ENCODER).joint) is Part.VALVE:
        return None
    most = CLEARLY * max(min(one.misfit for one in suspects), EXPLAINS)
    may_lie = [one for one in encoders if one.misfit <= most]
    return min(
        may_lie, key=lambda one: (one.kind is not Wrong.STUCK, one.misfit), default=None
    )  # what stands while oil flows needs no size that fits


def best_of(suspects: Sequence[Suspect], part: Part) -> Suspect:
    """The first suspect of a part that has one."""
    return next(one for one in suspects if one.part is part)


def named(suspects: Sequence[Suspect]) -> Suspect:
    """The first suspect, unless that is an encoder or a valve and the supply says the other."""
    first = suspects[0]
    says = _supply_says(suspects, first.joint)
    return best_of(suspects, says) if says and first.part in (Part.ENCODER, Part.VALVE) else first


def outdone(suspect: Suspect, other: Suspect) -> bool:
    """Whether another explains the residuals better, and not by chance."""
    return _badness(suspect) > BETTER * max(_badness(other), EXPLAINS)


def _supply_says(suspects: Sequence[Suspect], joint: str) -> Part | None:
    """Whether a piston went as its encoder shows, or as the commands of its valve: it lets the
    supply droop by one of the two. None where that tells nothing.
    """
    free = sorted(
        (one for one in suspects if _does_anything(one) and one.joint == joint),
        key=lambda one: -one.misfit,
    )
    least = {one.part: one.misfit for one in free}  # the last of each, over all onsets
    if len(least) < 2:
        return None
    more = least[Part.ENCODER] - least[Part.VALVE]
    if abs(more) < DROOPS:
        return None
    return Part.VALVE if more > 0.0 else Part.ENCODER


def _does_anything(suspect: Suspect) -> bool:
    """Whether it has no course of its own: only the supply tells an encoder that shows what it
    likes from a valve that does.
    """
    return (suspect.part, suspect.kind) in (
        (Part.VALVE, Wrong.STUCK),
        (Part.ENCODER, Wrong.ERRATIC),
    )


def _badness(suspect: Suspect) -> float:
    reserve = VALVE_RESERVE if suspect.part is Part.VALVE else 0.0
    if suspect.kind in HAVE_A_COURSE:
        reserve = COURSE_RESERVE
    elif _does_anything(suspect):
        reserve = ANYTHING_RESERVE[suspect.part]
    return (suspect.misfit + reserve) * RELUCTANCE.get(suspect.kind, 1.0)


def _tried(
    history: History,
    tolerance: Array,
    joints: Sequence[str],
    alarmed: Array,
    watched: Flags,
    oldest: int,
    back: int,
) -> list[Suspect]:
    """All that may have begun `back` blocks ago, by their misfit since the row `oldest`."""
    newest, sums = history.newest, history.sums
    row = newest - int(back)
    blocks = history.since(row)
    course = FaultSpan.of(blocks)
    at = np.arange(oldest, newest + 1)
    base = sums.residual[max(row - 4, oldest) : row + 1].mean(axis=0)
    deviation = FLOOR_SHARE * within(tolerance, sums, np.full(len(at), row), at)
    data = np.where(watched, (sums.residual[at] - base) / deviation, 0.0)
    found, unexplained = [], float(np.mean(data**2))
    for part, joint, kind, unit, whole, shape in _shapes(course, joints, alarmed):
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
            times = min(max(times, 1.0 / STRETCH), STRETCH) if unit else 1.0
        if times < 0.0 and kind in ONE_WAY:
            continue
        misfit = float(np.mean((data - times * model) ** 2))
        spread = math.sqrt(CORRELATED * max(misfit, 1.0) / power)
        if whole and misfit > EXPLAINED_BY_WHOLE * unexplained:
            continue
        if whole:
            spread = BETWEEN * whole if unit else 0.0
        begin = blocks[0].begin
        size = (whole or 1.0) * times
        error = 0.0
        if part is Part.ENCODER:
            own = 2 * joints.index(joint)
            error = abs(times) * float(np.abs(np.cumsum(shape[:, own : own + 2], axis=0)).max())
        found.append(Suspect(part, joint, kind, misfit, begin, size, spread, unit, error))
    return sorted(found, key=_badness)


def _before(data: Array, model: Array, first: Array, whole: float | None) -> Array:
    """What of a model (n, c) is too much, as the fault began within the block that adds `first`
    (n, c): the share of it that fits the data best.
    """
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


def _shapes(
    course: FaultSpan, joints: Sequence[str], alarmed: Array
) -> list[tuple[Part, str, Wrong, str, float | None, Array]]:
    """(n, c) a block of every fault that can have been."""
    n, count = len(course.since), 2 * len(joints) + 1
    shapes = []
    known = course.known.reshape(n, -1)
    for j in np.flatnonzero(alarmed[:-1].reshape(-1, 2).any(axis=1)).tolist():
        for one in signatures():
            begun = min(n - 1, 1)  # it may have moved before, in the first block
            quiet = float(np.abs(course.encoder[begun:, j]).sum()) < QUIET
            if one.part is Part.ENCODER and quiet != (one.kind is Wrong.STUCK):
                continue
            shape = np.zeros((n, count))
            shape[:, 2 * j : 2 * j + 2], shape[:, -1] = one.moves(course, j)
            shape[:, :-1] *= known
            shape[:, -1] *= course.feeding
            shapes.append((one.part, joints[j], one.kind, one.unit, one.whole, shape))
    for kind, unit, error in (
        (Wrong.OFFSET, "Pa", np.ones(n)),
        (Wrong.DRIFT, "Pa/s", course.since),
    ):
        shape = np.zeros((n, count))
        shape[:, :-1] = (course.fed * error[:, None, None]).reshape(n, -1) * known
        shape[:, -1] = error * course.feeding
        shapes.append((Part.SUPPLY, SUPPLY, kind, unit, None, shape))
    return shapes
