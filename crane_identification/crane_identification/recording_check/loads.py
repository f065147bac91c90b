"""Payloads that came or went while a recording was made, estimated by a model with values.

A fit takes what hangs at the tip for a part of the last link, one mass in a recording. So where a
load changed within it, the recording is two.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple, Self

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log, Signal
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.sensors import at_one_time
from crane_observer.payload.estimator import (
    HeldReadings,
    PayloadCondition,
    PayloadEstimate,
    PayloadEstimator,
)
from crane_observer.payload.filter import ModelDoubt, TipMechanics

# How much of what a model leaves of a recording is the weight of loads that come and go.
#
# With r what the model leaves of the drives' forces, each in units of its rms, and h what 1 kg at
# the tip asks of them. A load pulls at all joints, with one mass. A force of one joint, as of
# friction that follows the way since a reversal, leaves the others alone.

FORCE_WINDOW_S = 0.25  # s, over which forces are averaged, so that noise is
NO_PULL = 1e-12  # square of a pull [1/kg^2] or a force that is none
SHORTEST = 1.5  # s; a part in which a load is weighed has `MOVED` of motion, and lasts longer
MOVED = 2.0  # s of motion on both sides of a change: less tells a load badly
SURE = 6.5  # standard deviations by which two loads differ: five of the filter, see `scale.TOLD`
EXPLAINED = 0.5  # of the energy that a model leaves of a recording, by loads that change in it
A_LOAD = 1.0 - 1e-9  # likeness to the step of a load; 1 where but one joint moves
APART = 1.0  # s about a change that belong to neither side
# Chosen on a crane that rubs by the way since a reversal on one joint, as `rubbing` of the tests
# makes it: with more doubt weighings are worse, with less its friction is taken for loads.
FRICTION = 1.4  # times what a scale doubts of it, of a model that may lack an effect of it


@dataclass(frozen=True)
class Leftover:
    """Windows of a recording: `time` (w,) [s], model error (w, j), force of 1 kg (w, j) [1/kg]."""

    time: np.ndarray
    left: np.ndarray
    pull: np.ndarray

    @classmethod
    def of(cls, model: Model, log: Log, options: Options) -> Self:
        """`DataError` where the recording cannot be prepared."""
        return cls.of_runs(model, prepare(model, log, replace(options, average=False)))

    @classmethod
    def of_runs(cls, model: Model, runs: Sequence[Preparation]) -> Self:
        """Windows of a prepared recording, without averaging."""
        parts = [_left_and_pull(model, run) for run in runs]
        return cls(*(np.concatenate(parts_of_field) for parts_of_field in zip(*parts, strict=True)))

    def largest_share(self) -> float:
        """The largest `load_share` of any changes at least `SHORTEST` apart."""
        sums = [
            np.concatenate([[0.0], np.cumsum(values.sum(axis=1))])
            for values in (self.left * self.pull, self.pull**2)
        ]
        count = len(self.time)
        apart = max(int(SHORTEST / FORCE_WINDOW_S), 1)
        best = np.full(count + 1, -np.inf)
        best[0] = 0.0
        for end in range(min(apart, count), count + 1):
            begin = np.arange(end - apart + 1) if end >= apart else np.zeros(1, dtype=int)
            along, across = (one[end] - one[begin] for one in sums)
            best[end] = (best[begin] + along**2 / np.maximum(across, NO_PULL)).max()
        energy = float((self.left**2).sum())
        return float(best[-1]) / energy if energy > 0.0 else 0.0

    def load_share(self, changes: Sequence[float]) -> float:
        """Share 0..1 of the energy of r that loads explain, each constant between the `changes`."""
        energy, explained = float((self.left**2).sum()), 0.0
        for along, across in self._sums(changes):
            explained += float(along.sum()) ** 2 / max(float(across.sum()), NO_PULL)
        return explained / energy if energy > 0.0 else 0.0

    def likeness(self, begin: float, change: float, end: float, weighed: float) -> float:
        """At least 1 where r, from `begin` to `end` [s], steps at a `change` as a load does whose
        step the scale `weighed` [kg]; the smaller the less.

        Each joint may have its own m_j h_j of any cause, and m_j a step d_j. Beside the constant
        part of m_j, n_j is left of the squares of h_j. So one mass explains (sum n d)^2 / sum n of
        the steps, and one joint alone n_j d_j^2: less, unless others fall behind half of its step.
        And to take out what was weighed leaves less than before where that is at most twice the
        mass found, sum n d / sum n.
        """
        within = (self.time >= begin) & (self.time < end)
        sides = Leftover(self.time[within], self.left[within], self.pull[within])._sums([change])
        if len(sides) < 2:
            return 0.0
        (before, square_before), (after, square_after) = sides
        step = after / np.maximum(square_after, NO_PULL)
        step -= before / np.maximum(square_before, NO_PULL)
        told = square_before * square_after / np.maximum(square_before + square_after, NO_PULL)
        mass = float((told * step).sum() / max(float(told.sum()), NO_PULL))
        alone = float((told * step**2).max())
        together = mass**2 * float(told.sum())
        return min(together / max(alone, NO_PULL), 2.0 * mass / weighed)

    def _sums(self, changes: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Sums (j,) of r h and of h^2, in each part between the `changes` that has windows."""
        part = np.searchsorted(changes, self.time, side="right")
        rows = [part == number for number in np.unique(part)]
        products, squares = self.left * self.pull, self.pull**2
        return [(products[inside].sum(axis=0), squares[inside].sum(axis=0)) for inside in rows]


def _left_and_pull(model: Model, run: Preparation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (w,) [s], model error and force of 1 kg (w, j), over the rms of each force."""
    record = run.record
    force = record.needed("force", "the check of loads")
    unit = np.sqrt((force**2).mean(axis=0))
    left = np.where(run.moving, force - model.predict(record), 0.0) / unit
    mechanics = TipMechanics.of(model)
    count = max(1, round(len(left) * run.step / FORCE_WINDOW_S))
    windows = np.array_split(np.arange(len(left)), count)
    middle = [rows[len(rows) // 2] for rows in windows]
    weight = mechanics.weights(record.position[middle])
    moved = np.array([run.moving[rows].mean(axis=0) for rows in windows])
    mean = np.array([left[rows].mean(axis=0) for rows in windows])
    return record.time[middle], mean, weight * moved / unit


class PayloadPart(NamedTuple):
    """Payload in a part of a recording, between changes."""

    begin: float  # s; -inf: from the beginning of the recording
    deviation: float  # kg, standard deviation
    lightest: float  # kg, below which nothing is said
    masses: tuple[float, ...]  # kg, beside what the model has at the tip, of all its weighings

    @property
    def mass(self) -> float:
        """Mass of the part [kg]: the median of its estimates, whatever their deviations."""
        return median(self.masses)

    def differs(self, previous: "PayloadPart") -> bool:
        return abs(self.mass - previous.mass) > max(self.lightest, SURE * self._apart(previous))

    def beyond(self, previous: "PayloadPart") -> str:
        """How much more it is than another, in words [kg]."""
        return f"{self.mass - previous.mass:+.1f} ± {self._apart(previous):.1f}"

    def _apart(self, previous: "PayloadPart") -> float:
        """Standard deviation of their difference [kg]."""
        return math.hypot(self.deviation, previous.deviation)


def doubt_of(model: Model) -> ModelDoubt:
    """Doubt about a model that lacks an effect: it would be taken for changing loads."""
    doubt = ModelDoubt.of(model)
    return doubt._replace(dry=FRICTION * doubt.dry, viscous=FRICTION * doubt.viscous)


def payload_parts(model: Model, log: Log, options: Options) -> tuple[PayloadPart, ...]:
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
        scale = PayloadEstimator(model, doubt_of(model))
    except ConfigurationError:  # values or chambers are missing
        return ()
    parts: list[list[PayloadEstimate]] = [[]]
    for weighing in _weighings(scale, log):
        if weighing.changed and parts[-1]:
            parts.append([])
        parts[-1].append(weighing)
    found: list[PayloadPart] = []
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


def _of_loads(parts: Sequence[PayloadPart], leftover: Leftover) -> list[PayloadPart]:
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


def _as_one(parts: Sequence[PayloadPart]) -> PayloadPart:
    masses = tuple(mass for part in parts for mass in part.masses)
    deviation = min(part.deviation for part in parts)
    return PayloadPart(parts[0].begin, deviation, parts[0].lightest, masses)


def split_by_load(
    model: Model, logs: Sequence[Log], options: Options, prepared: Sequence[Preparation] = ()
) -> tuple[tuple[Log, ...], tuple[str, ...]]:
    """The recordings, those whose load changed in parts that carry one each; what was done, in
    words. A part that cannot be prepared, as for want of a whole period, is left out.

    What is `prepared` of them already, without averaging, is not prepared again. A recording of
    which no loads explain enough is not weighed. `DataError` where no part of any is left.
    """
    taken: list[Log] = []
    said: list[str] = []

    def parts_of(log: Log) -> tuple[PayloadPart, ...]:
        runs = [run for run in prepared if run.source == log.source]
        return payload_parts(model, log, options) if _may_change(model, log, options, runs) else ()

    for log, parts in zip(logs, map(parts_of, logs), strict=True):
        if len(parts) < 2:
            taken.append(log)
            continue
        said += [
            f"{log.source}: {words}; split into separate recordings" for words in _changes(parts)
        ]
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


def _may_change(model: Model, log: Log, options: Options, runs: Sequence[Preparation]) -> bool:
    """Return whether changing loads may explain enough of the model error."""
    try:
        known = Leftover.of_runs(model, runs) if runs else Leftover.of(model, log, options)
    except (ConfigurationError, DataError):
        return False
    return known.largest_share() >= EXPLAINED


def loads_in_words(model: Model, logs: Sequence[Log], options: Options) -> tuple[str, ...]:
    """Warnings: what a fit to these recordings takes for a mass of a link."""
    said: list[str] = []
    known: dict[str, PayloadPart] = {}
    for log in logs:
        parts = payload_parts(model, log, options)
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
    """Part of a log from `begin` to `end` [s], with time from its own first position."""
    part = log.during(max(begin, 0.0), end)
    zero = float(part.position.time[0])
    moved: dict[str, Any] = {}
    for name in (field.name for field in fields(part)):
        signal = getattr(part, name)
        if isinstance(signal, Signal):
            received = None if signal.received is None else signal.received - zero
            moved[name] = replace(signal, time=signal.time - zero, received=received)
    return replace(part, start=part.start + round(zero * NANOSECONDS), **moved)


def _changes(parts: Sequence[PayloadPart]) -> list[str]:
    return [
        f"the load at the tip changed at {after.begin:.1f} s, by {after.beyond(before)} kg"
        for before, after in pairwise(parts)
    ]


def _weighings(scale: PayloadEstimator, log: Log) -> list[PayloadEstimate]:
    assert log.pressure_a is not None and log.pressure_b is not None
    position, a, b = log.position, log.pressure_a, log.pressure_b
    latency = scale.machine.latency(scale.model.joints)
    chambers = np.concatenate([a.value, b.value], axis=1)
    return scale.recorded_estimates(
        HeldReadings.of(*at_one_time(position.time, position.value, latency)),
        HeldReadings.of(a.time, chambers),
    )


def _part(weighings: Sequence[PayloadEstimate]) -> PayloadPart | None:
    """The best of weighings between two changes, None where it is not worth much."""
    told = [
        weighing
        for weighing in weighings
        if weighing.moved >= MOVED
        and weighing.condition in (PayloadCondition.GOOD, PayloadCondition.AT_REST)
    ]
    if not told:
        return None
    best = min(told, key=lambda weighing: weighing.load.deviation)
    return PayloadPart(best.since, best.load.deviation, best.lightest, (best.load.mass,))
