"""Effects that passed the training recordings, before recordings that took no part."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.fit.evidence import relative, residual
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.fit.refit import UndeterminedError
from crane_identification.diagnosis.proof.extension import extended
from crane_identification.diagnosis.proof.gap import (
    RESOLUTION,
    Gap,
    HeldOut,
    measure,
    where_trained,
)
from crane_identification.diagnosis.proof.pulsation import (
    Line,
    Pulsation,
    clearest_lines,
    pulsations,
)
from crane_identification.diagnosis.proof.trial import Trial, tried
from crane_identification.diagnosis.search.energy import left_share
from crane_identification.diagnosis.search.loads import with_own_loads
from crane_identification.diagnosis.search.search import Search
from crane_identification.thresholds import Thresholds
from crane_model.progress_bar import Progress, silent


class Short(NamedTuple):
    """An effect that does not close the held-out gap, and what it does in words."""

    effect: Judged
    objection: str


@dataclass(frozen=True)
class Proof:
    """The effects that close the held-out `gap` where they act, in a `trial`; `short` do not.

    `before` is the trial without any; `lines` are the clearest of each joint in the spectrum of
    what the `trial` leaves, `pulsations` those that are clear enough.
    """

    before: Trial
    trial: Trial
    gap: Gap
    short: tuple[Short, ...] = ()
    lines: tuple[Line, ...] = ()
    pulsations: tuple[Pulsation, ...] = ()


def proved(
    fit: Fitted,
    search: Search,
    wanted: Sequence[Judged],
    thresholds: Thresholds,
    progress: Progress = silent,
) -> Proof:
    """The `wanted` effects, strongest first, without those that fall short beside the others.

    They are taken out one at a time, the weakest first: it may be what the others fall short by.
    What the strongest close may hide that a further one is worse than none.
    """
    before = tried(fit, search, (), thresholds)
    progress("what is left", 0.5)
    short: list[Short] = []
    while True:
        trial = tried(fit, search, wanted, thresholds) if wanted else before
        gap = measure(
            fit.before, trial.model, fit.evidence, fit.held_out, fit.periods, thresholds.method
        )
        failing = [
            Short(one, said) for one in trial.effects if (said := objection(one, gap, thresholds))
        ]
        if not failing and trial.effects and (said := resemblance(trial, before, thresholds)):
            failing = [Short(trial.effects[-1], said)]
        if not failing:
            failing = [
                Short(one, said)
                for one in trial.effects[1:]
                if (said := unmoved(fit, search, trial, one, gap, thresholds))
            ]
        if not failing:
            failing = spoiling(fit, search, trial, gap, thresholds)
        if not failing:
            break
        short.insert(0, failing[-1])
        wanted = [one for one in trial.effects if one is not failing[-1].effect]
    fewest = thresholds.method.pulsation_recordings
    lines = clearest_lines(trial.model, (*fit.evidence.runs, *fit.held_out.runs), fewest)
    progress("what is left", 1.0)
    progress("gap", 1.0)
    return Proof(before, trial, gap, tuple(short), lines, pulsations(lines, thresholds))


def objection(one: Judged, gap: Gap, thresholds: Thresholds) -> str:
    """Why an effect does not close the gap where it acts; empty if it does."""
    own = one.shaped.joints(gap.joints)
    held_to, method = gap.held_to, thresholds.method
    closed = held_to.closed_on(own)
    if not np.isfinite(closed):  # no gap that a model is known to close: it must not open one,
        ratio = held_to.after[own] / np.maximum(held_to.before[own], RESOLUTION)
        worse = (ratio > method.worse_factor) & (gap.after[own] > gap.before[own])
        still = not held_to.is_noise(own) and (ratio > 1.0 - RESOLUTION).all()  # and close some
        return _with_it(held_to, own) if still or worse.any() else ""
    least = method.simple_share if _simple(one, method.simple_share) else method.closed_share
    if closed >= least:
        return ""
    if closed < 0.0:
        return f"{_with_it(held_to, own)}; it should close {least:.0%} of the gap"
    return (
        f"it closes {closed:.0%} of what could be closed of the gap on held-out recordings, and "
        f"{least:.0%} are asked for"
    )


def unmoved(
    fit: Fitted, search: Search, trial: Trial, one: Judged, gap: Gap, thresholds: Thresholds
) -> str:
    """Why a further effect is no name: with all effects, hardly less is left on any joint that it
    acts on; empty if it is less. A scale acts on each joint that moves the bodies whose force it
    scales: without it, more must be left somewhere.
    """
    own, held_to, least = one.shaped.joints(gap.joints), gap.held_to, thresholds.method.fallen_share
    if _falls(held_to.before[own], held_to.after[own], least):
        return ""
    if one.shaped.candidate.effect.formless:
        rest = [other for other in trial.effects if other is not one]
        if _falls(held_out_error(fit, search, rest), held_to.after, least):
            return ""
    return f"{_with_it(held_to, own)}; a further effect should lessen its energy by {least:.0%}"


def _falls(before: np.ndarray, after: np.ndarray, least: float) -> bool:
    """Whether one of the errors (j,) falls by so much of its energy at least."""
    ratio = after / np.maximum(before, RESOLUTION)
    return bool((1.0 - ratio**2 >= least).any())


def spoiling(
    fit: Fitted, search: Search, trial: Trial, gap: Gap, thresholds: Thresholds
) -> list[Short]:
    """The weakest effect without which the others predict the force of its joint better, where
    others act on it too; none if there is no such effect. Of an effect on several joints, the
    geometric mean of their errors counts.
    """
    after = gap.held_to.after
    for one in reversed(trial.effects):
        rest = [other for other in trial.effects if other is not one]
        own = one.shaped.joints(gap.joints)
        if not any(set(own) & set(other.shaped.joints(gap.joints)) for other in rest):
            continue
        error = held_out_error(fit, search, rest)
        ratio = np.maximum(after[own], RESOLUTION) / np.maximum(error[own], RESOLUTION)
        if np.exp(np.log(ratio).mean()) > thresholds.method.worse_factor:
            worse = [j for j in own if after[j] > error[j]]
            told = (f"{gap.joints[j]} is {error[j]:.2%} and not {after[j]:.2%}" for j in worse)
            return [Short(one, f"without it, the held-out error of {', '.join(told)}")]
    return []


def held_out_error(fit: Fitted, search: Search, effects: Sequence[Judged]) -> np.ndarray:
    """Error (j,) of the model with the effects on the held-out rows where training went, relative
    to the force.
    """
    rows = where_trained(fit.evidence, fit.held_out)
    return relative(rows, left_held_out(fit, search, effects))


def left_held_out(fit: Fitted, search: Search, effects: Sequence[Judged]) -> np.ndarray:
    """What the model with the effects leaves of the held-out recordings (n, c), each with a load
    of its own.
    """
    model, _ = extended(search, fit.before, effects, fit.training)
    carried, _ = with_own_loads(model, fit.evidence, fit.held_out)
    return residual(fit.held_out, carried)


def resemblance(trial: Trial, before: Trial, thresholds: Thresholds) -> str:
    """Why effects but resemble what is missing; empty if they do not.

    They leave most of the energy beyond noise where they act, and explain less than half of what a
    learner explains besides: what is left follows a law, and that is not theirs.
    """
    least = thresholds.method.simple_share
    if trial.left_share <= 1.0 - least or (share := trial.explained(before)) >= least:
        return ""
    return (
        f"it explains {share:.0%} of what can be explained and leaves {trial.left_share:.0%} of "
        f"the energy beyond noise; {least:.0%} either way are asked for"
    )


def _with_it(gap: HeldOut, joints: Sequence[int]) -> str:
    """What becomes of the errors of the joints that an effect acts on."""
    return f"with it, {', '.join(gap.moved(j) for j in joints)}"


def _simple(one: Judged, share: float) -> bool:
    """Whether an effect is unlikely to be but like what is missing: it helps wherever it is asked,
    and no other is as good. One that a shape bends towards that leads by this share of its score.
    """
    asked = one.held_out[np.isfinite(one.held_out)]
    bent = one.shaped.shape or one.shaped.candidate.drawn
    alone = not one.indistinct and (not bent or one.margin > share * one.score)
    return alone and bool((asked > 0.0).all())


@dataclass(frozen=True)
class Nearest:
    """Effects that come closest to what is missing, strongest first, and why they are no names.

    `explained`: share of the energy beyond noise where they act. Held-out errors (j,) `before` and
    `after` they are added; these are NaN where the recordings do not determine them.
    """

    joints: tuple[str, ...]
    effects: tuple[Judged, ...]
    explained: float
    before: np.ndarray
    after: np.ndarray
    objection: str


def nearest(fit: Fitted, search: Search, effects: Sequence[Judged], objection: str) -> Nearest:
    """What `effects` would do to the fitted model."""
    before, held_out = fit.before, fit.held_out
    old = relative(held_out, residual(held_out, before))
    try:
        new = relative(held_out, left_held_out(fit, search, effects))
    except UndeterminedError:
        new = np.full_like(old, np.nan)
    left = left_share(search, [one.shaped for one in effects])
    return Nearest(
        joints=before.joints,
        effects=tuple(effects),
        explained=float(np.clip(1.0 - left, 0.0, 1.0)),
        before=old,
        after=new,
        objection=objection,
    )
