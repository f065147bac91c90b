"""The sets of the search that are findings, and effects that cannot be told from each."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.constants import LARGEST_SET
from crane_identification.diagnosis.judgement import (
    Beyond,
    Judged,
    Reason,
    Rejection,
    all_judged,
    by_chance,
    helps,
    likeness,
    simplest,
)
from crane_identification.diagnosis.lookalikes import of_one_form, with_strange
from crane_identification.diagnosis.projection import NOTHING, Subset
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.several import (
    as_kinds,
    best_pair,
    gain_of_few,
    on_several_joints,
    or_lengths,
    smallest,
)
from crane_identification.diagnosis.signatures import (
    as_drawn,
    best_beside,
    judged_beside,
    of_better_signature,
    start_beside,
)
from crane_identification.thresholds import Thresholds


@dataclass(frozen=True)
class Decision:
    """The effects that passed, strongest first, and the `threshold` of the first one. If there are
    none, `nearest` is the best of the catalogue with the tests that it does not pass. `beyond` is
    what the catalogue does not hold.
    """

    passed: tuple[Judged, ...]
    threshold: float
    nearest: tuple[Judged, ...]
    rejections: tuple[Rejection, ...]
    beyond: tuple[Beyond, ...]


def decide(selection: ForwardSelection) -> Decision:
    """The largest set of effects that pass all tests, beside lengths if one scales a force."""
    threshold = by_chance(selection.search, NOTHING)
    passed = settled = _together(selection, threshold)
    first: _Weighed | None = None
    for one in _growing(selection, settled, threshold):
        first = first or one
        if one.rejections:
            continue
        passed = one.found
        if not settled and any(_scales(each) for each in passed):
            passed = _beside_lengths(selection, passed, threshold)
            break
    passed = as_drawn(selection, passed)
    if start_beside(selection, passed):
        passed = _largest(_growing(selection, passed, threshold), passed)
    passed, beyond = with_strange(selection.search, passed, threshold)
    passed = or_lengths(selection.search, sorted(passed, key=lambda one: -one.score))
    if settled or first is None:
        return Decision(passed, threshold, (), (), beyond)
    least = selection.search.thresholds.gates.smallest_strength
    shows = (one.strength >= least and one.score > one.threshold for one in first.found)
    if first.rejections and all(shows):  # more than machines from which nothing is missing
        labels = tuple(one.shaped.candidate.label for one in first.found)
        beyond = (Beyond(effects=labels, rejections=first.rejections), *beyond)
    return Decision(passed, threshold, first.found, first.rejections, beyond)


class _Weighed(NamedTuple):
    """Effects that were weighed together, and the tests that they do not pass."""

    found: tuple[Judged, ...]
    rejections: tuple[Rejection, ...] = ()


def _growing(
    selection: ForwardSelection, settled: tuple[Judged, ...], threshold: float
) -> Iterator[_Weighed]:
    """Yield the best set of one more effect, and so on, until no set gains enough."""
    known, passed = len(settled), settled
    while len(passed) < known + LARGEST_SET:
        size = len(passed) + 1
        best = best_beside(selection, size, settled)
        if best is None:
            return
        gain = best.gain - selection.sets(size - 1)[0].gain
        if gain < left_by_forms(passed, selection.search.thresholds):
            return
        yield (weighed := _weighed(selection.search, best, settled, threshold))
        if not weighed.rejections:
            passed = weighed.found
        elif gain > threshold:
            selection.refuse(size, _new(selection.search, best, passed))
        else:
            return


def left_by_forms(passed: Sequence[Judged], thresholds: Thresholds) -> float:
    """Gain that the strongest effect leaves at most if its form is not the machine's."""
    most = max((one.score for one in passed if not _scales(one)), default=0.0)
    return thresholds.method.elsewhere_share * most


def _new(search: Search, subset: Subset, passed: tuple[Judged, ...]) -> set[Candidate]:
    """The candidates of a set beside those that passed, and all that are but forms of them."""
    candidates = search.projection.candidates
    known = {one.shaped.candidate for one in passed}
    numbers = [i for i in subset.numbers if candidates[i].candidate not in known]
    effect, refused = search.projection.effect, set[Candidate]()
    for number in numbers or subset.numbers:
        same = effect == effect[number]
        alike = likeness(search, number, range(len(candidates)))
        same |= alike > search.thresholds.method.form_correlation
        refused |= {candidates[i].candidate for i in np.flatnonzero(same)}
    return refused - known


def _weighed(
    search: Search, best: Subset, settled: tuple[Judged, ...], threshold: float
) -> _Weighed:
    """The effects of a set by every test; `settled` scales and curves are not tested again."""
    known = len(settled)
    subset = simplest(search, best, threshold, known)
    subset = smallest(search, subset, threshold)
    several = len(subset.numbers) > 1
    if several and of_one_form(search, subset, threshold, known):
        return _Weighed((), (Rejection(Reason.FORM),))
    subset, strange = of_better_signature(search, subset, known)
    found = judged_beside(search, subset, settled)
    asked = [
        one
        for k, one in enumerate(found)
        if k >= known or not (_scales(one) or one.shaped.candidate.drawn)
    ]
    wrong = [why for one in asked if (why := objection(one, search.thresholds))] or strange
    weakest = min(found[known:], key=lambda one: one.score)
    # A rest that others of another shape explain as well remains if the first effect has another
    # form.
    vague = weakest.indistinct and (weakest.correlation < search.thresholds.method.form_correlation)
    if not wrong and several and vague:
        wrong = [Rejection(Reason.RIVALS, about=(weakest.shaped.candidate.label,))]
    return _Weighed(tuple(found), tuple(wrong))


def _largest(growing: Iterable[_Weighed], settled: tuple[Judged, ...]) -> tuple[Judged, ...]:
    """The last of these that pass, or what is `settled`."""
    passed = [one.found for one in growing if not one.rejections]
    return passed[-1] if passed else settled


def _beside_lengths(
    selection: ForwardSelection, passed: tuple[Judged, ...], threshold: float
) -> tuple[Judged, ...]:
    """The effects that pass beside lengths of all links and the scales of two joints' forces, which
    stand for those of all; these as well, as far as they pass. Lengths that are not those of the
    file are so on each joint. With one scale alone, what the others leave may be taken for a
    further effect.
    """
    search = selection.search = selection.search.beside_lengths()
    named = search.together(one.shaped for one in passed if _scales(one))
    scales = max(best_pair(search), named, key=lambda one: one.gain)
    scales = smallest(search, scales, threshold)
    selection.go_on_from(scales)
    settled = tuple(all_judged(selection.search, scales))
    found = _largest(_growing(selection, settled, threshold), settled)
    return _sure(selection, found) or passed


def _sure(selection: ForwardSelection, found: tuple[Judged, ...]) -> tuple[Judged, ...]:
    """The effects without scales that do not pass or may be another effect, judged anew."""
    scales = sorted((one for one in found if _scales(one)), key=lambda one: one.score)
    out = [one for one in scales if objection(one, selection.search.thresholds)]
    mistakable = any(not other.effect.formless for one in scales for other in one.indistinct)
    out += scales[:1] if len(scales) > 1 and mistakable else []
    left = [one for one in found if not any(one is other for other in out)]
    if len(left) == len(found) or not left:
        return tuple(left)
    selection.go_on_from(selection.search.together(one.shaped for one in left))
    return tuple(all_judged(selection.search, selection.search.sets[-1][0]))


def _scales(one: Judged) -> bool:
    """Return whether an effect scales the force of a joint, as wrong lengths do."""
    return one.shaped.candidate.effect.formless


def _together(selection: ForwardSelection, threshold: float) -> tuple[Judged, ...]:
    """Effects that several joints lack at once; none if few effects explain about as much."""
    search = selection.search
    subset = on_several_joints(search, threshold)
    few = search.thresholds.method.further_share * subset.gain
    if subset.gain - gain_of_few(search) <= few:
        return ()
    while subset.numbers:
        selection.go_on_from(subset)
        found = all_judged(selection.search, subset)
        found = as_kinds(selection.search, found, len(found))
        left = [one for one in found if not objection(one, search.thresholds)]
        if len(left) == len(found):
            return tuple(found)
        subset = search.together(one.shaped for one in left)
    selection.go_on_from(NOTHING)
    return ()


def objection(one: Judged, thresholds: Thresholds) -> Rejection | None:
    """The test that an effect does not pass; None if it passes all."""
    if one.score <= one.threshold:
        return Rejection(Reason.SCORE, one.score, one.threshold)
    least = thresholds.gates.smallest_strength
    if one.strength < least and not _scales(one):  # what is usual of a scale says its value
        return Rejection(Reason.STRENGTH, one.strength, least)
    if not helps(one.held_out, thresholds):
        asked = one.held_out[np.isfinite(one.held_out)]
        return Rejection(Reason.HELD_OUT, int((asked > 0.0).sum()), len(one.held_out))
    return None
