"""Whether a further effect is but the form of another one, which its law leaves over."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.decision.apart import shows_alone, stands_apart
from crane_identification.diagnosis.decision.judgement import marginal
from crane_identification.diagnosis.decision.likeness import without
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.energy import channels, unexplained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset
from crane_identification.thresholds import Thresholds


def faint(
    gains: Sequence[float], share: float, asked: Collection[int], formless: Collection[int] = ()
) -> bool:
    """Whether one of the effects `asked` gains less than that share of what the strongest does of
    those that are not `formless`.
    """
    most = max((gain for place, gain in enumerate(gains) if place not in formless), default=0.0)
    return any(gains[place] < share * most for place in asked)


def slight(
    channels: Sequence[np.ndarray],
    gains: Sequence[float],
    share: float,
    asked: Collection[int],
    formless: Collection[int] = (),
) -> bool:
    """Whether one of the effects `asked` gains less than that share of what another law does in
    one of its channels: what a law leaves because it is not quite that of the machine is on its own
    joint, most of it. Those that are `formless` leave nothing.
    """
    where = [set(one.tolist()) for one in channels]
    return any(
        gains[place] < share * gains[k]
        for place in asked
        for k in range(len(where))
        if k not in formless and where[place] & where[k]
    )


def mends(
    search: Search,
    numbers: Sequence[int],
    gains: Sequence[float],
    share: float,
    asked: Collection[int],
) -> bool:
    """Whether one of several laws that resist the motion, of those `asked`, gains less than that
    share of what another of these does on its joint: so much is left by the form of that one.
    """
    candidates = search.projection.candidates
    resisting: dict[str, list[tuple[int, float]]] = {}
    for place, (number, gain) in enumerate(zip(numbers, gains, strict=True)):
        joint = candidates[number].candidate.joint
        if joint is not None and reverses(search, candidates[number]):
            resisting.setdefault(joint, []).append((place, gain))
    return any(
        place in asked and gain < share * max(other for _, other in one)
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
    gains, method = marginal(search, subset), thresholds.method
    effects = [search.projection.candidates[number].candidate.effect for number in subset.numbers]
    formless = {place for place, effect in enumerate(effects) if effect.formless}
    places = [
        place
        for place in range(settled, len(gains))
        if not shows_alone(search, subset, gains, place, chance, thresholds)
    ]
    if faint(gains, method.elsewhere_share, places, formless):
        return True
    further = [place for place in places if not fills(search, subset, place, chance, thresholds)]
    where = [channels(search, number) for number in subset.numbers]

    def of_another(asked: Collection[int]) -> bool:
        return slight(where, gains, method.further_share, asked, formless) or mends(
            search, subset.numbers, gains, method.form_share, asked
        )

    return of_another(further) and of_another(
        [
            place
            for place in further
            if not stands_apart(search, subset, gains, place, chance, thresholds)
        ]
    )


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
