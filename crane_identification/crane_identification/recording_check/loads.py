"""Loads at the tip that came or went while a recording was made, weighed by a model with values.

A fit takes what hangs at the tip for a part of the last link, one mass in a recording. So where a
load changed within it, the recording is two.
"""

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log, Signal
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.recording_check.load_share import Leftover
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.scale import Scale, ScaleCondition, Weighing

MOVED = 2.0  # s of motion on both sides of a change: less tells a load badly
LIGHTEST = 5.0  # kg, below which nothing is said
SURE = 6.5  # standard deviations by which two loads differ: five of the filter, see `scale.TOLD`
EXPLAINED = 0.5  # of the energy that a model leaves of a recording, by loads that change in it
A_LOAD = 1.0 - 1e-9  # likeness to the step of a load; 1 where but one joint moves
APART = 1.0  # s about a change that belong to neither side
# Chosen on a crane that rubs by the way since a reversal on one joint, as `rubbing` of the tests
# makes it: with more doubt weighings are worse, with less its friction is taken for loads.
FRICTION = 1.4  # times what a scale doubts of it, of a model that may lack an effect of it
READINGS = 4e3  # Pa, noise of a window, whatever a scale allows for


class WeighedPart(NamedTuple):
    """What hung at the tip in a part of a recording, between changes."""

    begin: float  # s; -inf: from the beginning of the recording
    deviation: float  # kg, standard deviation
    masses: tuple[float, ...]  # kg, beside what the model has at the tip, of all its weighings

    @property
    def mass(self) -> float:
        """Of the part [kg]: the median of its weighings. Where these differ for want of a model,
        their deviations do not tell which is right.
        """
        return median(self.masses)

    def differs(self, other: "WeighedPart") -> bool:
        """Whether it is surely another load."""
        return abs(self.mass - other.mass) > max(LIGHTEST, SURE * self._apart(other))

    def beyond(self, other: "WeighedPart") -> str:
        """How much more it is than another, in words [kg]."""
        return f"{self.mass - other.mass:+.1f} ± {self._apart(other):.1f}"

    def _apart(self, other: "WeighedPart") -> float:
        """Standard deviation of their difference [kg]."""
        return math.hypot(self.deviation, other.deviation)


def doubt_of(model: Model) -> ModelDoubt:
    """Of a model that may lack an effect which is still to be found, as friction that is built up
    along a way since a reversal: else it is taken for loads that come and go.
    """
    doubt = ModelDoubt.of(model)
    return doubt._replace(
        dry=FRICTION * doubt.dry, viscous=FRICTION * doubt.viscous, sensors=READINGS
    )


def weighed_parts(model: Model, log: Log, options: Options) -> tuple[WeighedPart, ...]:
    """In their order, each surely another load than the one before; empty where nothing can be
    weighed: the model needs values and the machine in it, the log pressures of all its joints.

    Changes at which what the model leaves steps on one joint rather than by one mass on all of them
    are that joint's, as of friction, and no load; and those that explain less than `EXPLAINED` of
    it are of a model that errs elsewhere: one part.
    """
    signals = log.pressure_a, log.pressure_b
    if log.uncalibrated or signals[0] is None or signals[1] is None or model.machine is None:
        return ()
    try:
        scale = Scale(model, doubt_of(model))
    except ConfigurationError:  # values or chambers are missing
        return ()
    parts: list[list[Weighing]] = [[]]
    for one in _weighings(scale, log):
        if one.changed and parts[-1]:
            parts.append([])
        parts[-1].append(one)
    found: list[WeighedPart] = []
    for part in filter(None, map(_part, parts)):
        if not found or part.differs(found[-1]):
            found.append(part)
    if len(found) < 2:
        return tuple(found)
    try:
        leftover = Leftover.of(model, log, options)
    except DataError:
        return (_as_one(found),)
    found = _of_loads(found, leftover)
    if leftover.load_share([part.begin for part in found[1:]]) < EXPLAINED:
        return (_as_one(found),)
    return tuple(found)


def _of_loads(parts: Sequence[WeighedPart], leftover: Leftover) -> list[WeighedPart]:
    """The parts, those made one between which a joint's own force changed rather than a load."""
    found = list(parts)
    while len(found) > 1:
        ends = [*(part.begin for part in found[2:]), math.inf]
        alike = [
            leftover.likeness(before.begin, after.begin, end, after.mass - before.mass)
            if after.differs(before)
            else -math.inf
            for (before, after), end in zip(pairwise(found), ends, strict=True)
        ]
        if min(alike) >= A_LOAD:
            break
        place = alike.index(min(alike))
        found[place : place + 2] = [_as_one(found[place : place + 2])]
    return found


def _as_one(parts: Sequence[WeighedPart]) -> WeighedPart:
    """All of the parts."""
    masses = tuple(mass for part in parts for mass in part.masses)
    deviation = min(part.deviation for part in parts)
    return WeighedPart(parts[0].begin, deviation, masses)


def split_by_load(
    model: Model, logs: Sequence[Log], options: Options
) -> tuple[tuple[Log, ...], tuple[str, ...]]:
    """The recordings, those whose load changed in parts that carry one each; what was done, in
    words. A part that cannot be prepared, as for want of a whole period, is left out.

    `DataError` where no part of any recording is left.
    """
    taken: list[Log] = []
    said: list[str] = []
    for log in logs:
        parts = weighed_parts(model, log, options)
        if len(parts) < 2:
            taken.append(log)
            continue
        said += [f"{log.source}: {words}; taken as recordings apart" for words in _changes(parts)]
        ends = [part.begin for part in parts[1:]]
        for number, (begin, end) in enumerate(pairwise([-math.inf, *ends, math.inf]), 1):
            name = f"{log.source}, part {number}"
            try:
                piece = replace(_piece(log, begin + APART, end - APART), source=name)
                prepare(model, piece, options)
            except DataError as error:
                said.append(f"{name}: left out: {error}")
            else:
                taken.append(piece)
    if logs and not taken:
        said.append("no part is left; record again with one load at the tip")
        raise DataError("\n".join(said))
    return tuple(taken), tuple(said)


def loads_in_words(model: Model, logs: Sequence[Log], options: Options) -> tuple[str, ...]:
    """Warnings: what a fit to these recordings takes for a mass of a link."""
    said: list[str] = []
    known: dict[str, WeighedPart] = {}
    for log in logs:
        parts = weighed_parts(model, log, options)
        said += [
            f"{log.source}: {words}; a part of that is in the masses of the model. Leave the "
            "recording out, or part of it (--from, --to)"
            for words in _changes(parts)
        ]
        if len(parts) == 1:
            known[log.source] = parts[0]
    if not known:
        return tuple(said)
    lightest = min(known.values(), key=lambda part: part.mass)
    for source, part in known.items():
        if part.differs(lightest):
            said.append(
                f"{source}: carries {part.beyond(lightest)} kg more than the lightest recording; "
                "a part of that is in the masses of the model. Leave it out, or let diagnose find "
                "what each carries"
            )
    return tuple(said)


def _piece(log: Log, begin: float, end: float) -> Log:
    """What was recorded from `begin` to `end` [s], its time from its own first position."""
    part = log.during(max(begin, 0.0), end)
    zero = float(part.position.time[0])
    moved: dict[str, Any] = {}
    for name in (one.name for one in fields(part)):
        signal = getattr(part, name)
        if isinstance(signal, Signal):
            received = None if signal.received is None else signal.received - zero
            moved[name] = replace(signal, time=signal.time - zero, received=received)
    return replace(part, start=part.start + round(zero * NANOSECONDS), **moved)


def _changes(parts: Sequence[WeighedPart]) -> list[str]:
    return [
        f"the load at the tip changed at {after.begin:.1f} s, by {after.beyond(before)} kg"
        for before, after in pairwise(parts)
    ]


def _weighings(scale: Scale, log: Log) -> list[Weighing]:
    """Of a whole log, reading by reading in the order of stamps."""
    assert log.pressure_a is not None and log.pressure_b is not None
    position, a, b = log.position, log.pressure_a, log.pressure_b
    found: list[Weighing] = []
    next_, count = 0, len(position.time)
    for k, time in enumerate(a.time.tolist()):
        while next_ < count and position.time[next_] <= time:
            scale.add_encoders(float(position.time[next_]), position.value[next_])
            next_ += 1
        found += scale.add_pressures(time, a.value[k], b.value[k])
    return found


def _part(weighings: Sequence[Weighing]) -> WeighedPart | None:
    """The best of weighings between two changes, None where it is not worth much."""
    told = [
        one
        for one in weighings
        if one.moved >= MOVED and one.condition in (ScaleCondition.GOOD, ScaleCondition.AT_REST)
    ]
    if not told:
        return None
    best = min(told, key=lambda one: one.load.deviation)
    return WeighedPart(best.since, best.load.deviation, (best.load.mass,))
