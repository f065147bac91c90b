"""Whether a further effect is but the form of another one, which its law leaves over."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.decision.apart import stands_apart
from crane_identification.diagnosis.decision.judgement import marginal
from crane_identification.diagnosis.decision.likeness import without
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.energy import channels, unexplained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset
from crane_identification.thresholds import Thresholds


def slight(
    channels: Sequence[np.ndarray],
    gains: Sequence[float],
    thresholds: Thresholds,
    settled: int = 0,
    formless: Collection[int] = (),
    filling: Collection[int] = (),
) -> bool:
    """Whether one of several effects gains too little beside another to be told from its form.

    `channels` are those where each acts. What a law leaves because it is not quite that of the
    machine is on its own joint, most of it; those that are `formless` leave nothing. Of one that is
    `filling` what the others leave, or stands apart from them, no more is asked there than
    elsewhere. The first ones, that are `settled`, are not asked.
    """
    where, method = [set(one.tolist()) for one in channels], thresholds.method
    for place in range(settled, len(where)):
        laws = [k for k in range(len(where)) if k == place or k not in formless]
        there = max(gains[k] for k in laws if where[place] & where[k])
        most = max(gains[k] for k in laws)
        share = method.elsewhere_share if place in filling else method.further_share
        if gains[place] < max(share * there, method.elsewhere_share * most):
            return True
    return False


def mends(
    search: Search,
    numbers: Sequence[int],
    gains: Sequence[float],
    thresholds: Thresholds,
    settled: int = 0,
    filling: Collection[int] = (),
) -> bool:
    """Whether one of several laws that resist the motion gains too little beside another of these
    on its joint to be more than what that one's form leaves. The first, `settled`, are not asked,
    nor those that are `filling` what the others leave or stand apart.
    """
    candidates, share = search.projection.candidates, thresholds.method.form_share
    resisting: dict[str, list[tuple[int, float]]] = {}
    for place, (number, gain) in enumerate(zip(numbers, gains, strict=True)):
        joint = candidates[number].candidate.joint
        if joint is not None and reverses(search, candidates[number]):
            resisting.setdefault(joint, []).append((place, gain))
    return any(
        place >= settled and place not in filling and gain < share * max(other for _, other in one)
        for one in resisting.values()
        for place, gain in one
    )


def reverses(search: Search, shaped: ShapedCandidate) -> bool:
    """Whether the force of a candidate changes its sign with the velocity, and nothing else."""
    setting = search.evidence.model.setting
    for run in search.evidence.runs:
        record = replace(run.record, direction_known=None)
        there = shaped.term.columns(record, setting)
        back = shaped.term.columns(replace(record, velocity=-record.velocity), setting)
        if there.any():
            return bool(np.allclose(back, -there))
    return False


def of_one_form(
    search: Search, subset: Subset, chance: float, thresholds: Thresholds, settled: int = 0
) -> bool:
    """Whether an effect of a set is but the form of another one of them; not of those `settled`.
    `chance` gives so much to the best effect when nothing is missing.

    Changes of terms that the model has are of the model's own form.
    """
    if all(search.projection.candidates[number].candidate.changes for number in subset.numbers):
        return False
    gains = marginal(search, subset)
    where = [channels(search, number) for number in subset.numbers]
    effects = [search.projection.candidates[number].candidate.effect for number in subset.numbers]
    formless = {place for place, effect in enumerate(effects) if effect.formless}

    def of_another(apart: set[int]) -> bool:
        return slight(where, gains, thresholds, settled, formless, apart) or mends(
            search, subset.numbers, gains, thresholds, settled, apart
        )

    filling = {
        place for place in range(len(effects)) if fills(search, subset, place, chance, thresholds)
    }
    if not of_another(filling):
        return False
    apart = {
        place
        for place in range(settled, len(effects))
        if place not in filling and stands_apart(search, subset, gains, place, chance, thresholds)
    }
    return not apart or of_another(filling | apart)


def fills(
    search: Search, subset: Subset, place: int, chance: float, thresholds: Thresholds
) -> bool:
    """Whether one effect of a set explains most of what the others leave beyond noise where it
    acts, which is more than `chance`: of what the form of a law leaves, another explains a part.
    """
    own = channels(search, subset.numbers[place])
    before, after = (
        float(unexplained(search, one)[own].sum())
        for one in (without(search, subset, place), subset)
    )
    return before > chance and after <= (1.0 - thresholds.method.simple_share) * before
