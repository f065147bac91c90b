"""Whether a further effect, however weak, is none of what stronger ones leave over.

A law that is not quite the machine's leaves a share of its own force, which a further effect may
resemble. How much that is, is known where the shape of the stronger one can be drawn: a shape that
explains no more than the law, in training and of recordings that it was not fitted to, says that
the law is the machine's, and leaves nothing. On another joint it leaves something through the
bodies alone that both joints move.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.decision.cross_validation import Folds, held_out_gains, helps
from crane_identification.diagnosis.decision.judgement import folds_asked, found_values
from crane_identification.diagnosis.decision.shape import chance_of
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.energy import channels, explained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset
from crane_identification.diagnosis.search.whitening import whitened_base
from crane_identification.thresholds import Thresholds


def stands_apart(
    search: Search,
    subset: Subset,
    gains: Sequence[float],
    place: int,
    chance: float,
    thresholds: Thresholds,
) -> bool:
    """Whether one effect of a set, with these `gains`, explains beside any shape of the stronger
    ones what it does beside their laws, more than `chance` and of recordings that it was not fitted
    to; and each of these laws leaves nothing to its shape, or is drawn. Those without a form leave
    nothing either.
    """
    found = [search.projection.candidates[number] for number in subset.numbers]
    own, rest = found[place], [one for k, one in enumerate(found) if k != place]
    stronger = [
        one
        for one, gain in zip(found, gains, strict=True)
        if one is not own and gain > gains[place] and not one.candidate.effect.formless
    ]
    shapes = [search.shapes.of(one.candidate) for one in stronger]
    drawn = [shape for shape in shapes if shape is not None]
    if len(drawn) < len(stronger):
        return False
    if not all(
        _is_the_machines(search, found, law, shape, thresholds)
        for law, shape in zip(stronger, drawn, strict=True)
    ):
        return False
    least = max(chance, thresholds.method.simple_share * gains[place])
    return _explains_beside(search, (*rest, *drawn), own, least, thresholds)


def shows_alone(
    search: Search,
    subset: Subset,
    gains: Sequence[float],
    place: int,
    chance: float,
    thresholds: Thresholds,
) -> bool:
    """Whether one effect of a set, with these `gains`, acts on a joint alone that no stronger law
    is on, and explains there most of what it does, more than `chance` and of recordings that it was
    not fitted to, if that joint has bodies of its own.
    """
    found = [search.projection.candidates[number] for number in subset.numbers]
    own, rest = found[place], [one for k, one in enumerate(found) if k != place]
    joint, joints = own.candidate.joint, search.evidence.joints
    if joint is None or {
        joints[c % len(joints)] for c in channels(search, subset.numbers[place])
    } != {joint}:
        return False
    stronger = {
        one.candidate.joint
        for one, gain in zip(found, gains, strict=True)
        if gain > gains[place] and not one.candidate.effect.formless
    }
    if stronger & {joint, None}:
        return False
    alone = _on_joint(search, joints.index(joint))
    least = max(chance, thresholds.method.simple_share * gains[place])
    asked = folds_asked(search, own, found_values(search, subset, place))
    return _explains_beside(alone, rest, own, least, thresholds, asked)


def _explains_beside(
    search: Search,
    others: Sequence[ShapedCandidate],
    own: ShapedCandidate,
    least: float,
    thresholds: Thresholds,
    asked: Folds | None = None,
) -> bool:
    """Whether an effect explains more than `least` beside the others, and of the folds `asked`, all
    if none is given, that it was not fitted to.
    """
    known = [one.columns for one in others]
    if explained(search, *known, own.columns) - explained(search, *known) <= least:
        return False
    before = np.concatenate([search.evidence.free, *known], axis=2)
    held_out, _ = held_out_gains(search.evidence, search.whitener, before, own.columns, asked)
    return helps(held_out, thresholds)


def _on_joint(search: Search, j: int) -> Search:
    """The search with the rows of joint j alone, whose values of the model are free of the others:
    to ask what `columns` explain there.
    """
    whitener = search.whitener.on(range(j, len(search.whitener.noise), len(search.evidence.joints)))
    return replace(search, whitener=whitener, base=whitened_base(search.evidence, whitener))


def _is_the_machines(
    search: Search,
    found: Sequence[ShapedCandidate],
    law: ShapedCandidate,
    shape: ShapedCandidate,
    thresholds: Thresholds,
) -> bool:
    """Whether the shape explains no more beside all that was `found`, its law among it, than chance
    does; one that is drawn has no other law.
    """
    if law.candidate.drawn:
        return True
    columns = [one.columns for one in found]
    limit = chance_of(shape.columns, thresholds)
    if explained(search, *columns, shape.columns) - explained(search, *columns) > limit:
        return False
    before = np.concatenate([search.evidence.free, *columns], axis=2)
    gains, _ = held_out_gains(search.evidence, search.whitener, before, shape.columns)
    return bool(np.nansum(gains) <= limit)
