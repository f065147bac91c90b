"""Effects that passed the training recordings, before recordings that took no part."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.decision import Judged
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.extension import Training
from crane_identification.diagnosis.gap import Gap, measure
from crane_identification.diagnosis.learner import Features
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.thresholds import Thresholds
from crane_identification.diagnosis.trial import Trial, tried
from crane_identification.preparation.run import Preparation
from crane_model.model_file import Model


class Short(NamedTuple):
    """An effect that does not close the held-out gap, and what it does in words."""

    effect: Judged
    objection: str


@dataclass(frozen=True)
class Proof:
    """The effects that close the held-out `gap` where they act, in a `trial`; `short` do not."""

    trial: Trial
    gap: Gap
    short: tuple[Short, ...]


def proved(
    found: Search,
    before: Model,
    wanted: Sequence[Judged],
    training: Training,
    known: Features,
    held_out: Evidence,
    periods: Sequence[Preparation],
    thresholds: Thresholds,
) -> Proof:
    """The `wanted` effects, strongest first, without those that fall short beside the others.

    They are taken out one at a time, the weakest first: it may be what the others fall short by.
    `periods`: held-out recordings averaged, which the noise is known from.
    """
    short: list[Short] = []
    while True:
        trial = tried(found, before, wanted, training, known, thresholds)
        gap = measure(before, trial.model, found.evidence, held_out, periods, thresholds.method)
        failing = [
            Short(one, said) for one in trial.effects if (said := objection(one, gap, thresholds))
        ]
        if not failing:
            return Proof(trial, gap, tuple(short))
        short.insert(0, failing[-1])
        wanted = [one for one in trial.effects if one is not failing[-1].effect]


def objection(one: Judged, gap: Gap, thresholds: Thresholds) -> str:
    """Why an effect does not close the gap where it acts; empty if it does."""
    joint = one.option.family.joint
    own = [j for j, name in enumerate(gap.joints) if joint in (name, None)]
    closed = gap.closed_on(own)
    if not np.isfinite(closed):  # there is no gap: it must not open one
        worse = [j for j in own if gap.after[j] > thresholds.method.worse_factor * gap.before[j]]
        return _enlarging(gap, worse) if worse else ""
    method = thresholds.method
    least = method.simple_share if _simple(one) else method.closed_share
    if closed >= least:
        return ""
    if closed < 0.0:
        larger = [j for j in own if gap.after[j] > gap.before[j]]
        return f"{_enlarging(gap, larger)}; it should close {least:.0%} of the gap"
    return (
        f"it closes {closed:.0%} of what could be closed of the gap on held-out recordings, and "
        f"{least:.0%} are asked for"
    )


def _enlarging(gap: Gap, joints: Sequence[int]) -> str:
    """That an effect makes the errors of these joints larger."""
    return f"with it, {', '.join(gap.moved(j) for j in joints)}"


def _simple(one: Judged) -> bool:
    """Whether an effect is unlikely to be but like what is missing: no shape bends it towards that,
    no other effect is as good, and it helps wherever it is asked.
    """
    asked = one.held_out[np.isfinite(one.held_out)]
    return not (one.members or one.option.shape) and bool((asked > 0.0).all())
