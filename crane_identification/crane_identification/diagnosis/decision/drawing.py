"""The race beside shapes that were drawn.

Where no law fits an effect, what its law leaves hides a weaker one. Its shape leaves nothing:
further effects are sought beside that, with all of its values free.
"""

from collections.abc import Sequence

from crane_identification.diagnosis.decision.judgement import Judged, all_judged
from crane_identification.diagnosis.decision.several import as_kinds
from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.diagnosis.search.race import Race
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset, solve
from crane_identification.diagnosis.search.shapes import shape_of
from crane_identification.thresholds import Thresholds


def is_drawn(one: Judged) -> bool:
    """Whether an effect has the shape that was drawn."""
    return one.shaped.candidate.drawn


def beside_drawn(passed: Sequence[Judged]) -> tuple[Judged, ...]:
    """What passed, without laws of a shape that was drawn on their joint, which holds them."""
    drawn = [one.shaped.candidate for one in passed if is_drawn(one)]
    return tuple(
        one
        for one in passed
        if is_drawn(one) or not any(_of_shape(one.shaped.candidate, shape) for shape in drawn)
    )


def start_beside(race: Race, passed: Sequence[Judged]) -> bool:
    """Let the race go on from effects of which some were drawn; false where none was, or where they
    have no solution together.
    """
    if not any(is_drawn(one) for one in passed):
        return False
    start = solve(race.search.projection, tuple(race.search.number(one.shaped) for one in passed))
    if start is None:
        return False
    race.go_on_from(start)
    return True


def best_beside(race: Race, size: int, settled: Sequence[Judged]) -> Subset | None:
    """The best set of so many effects without another law of a shape that is `settled` as it was
    drawn; None if there is none.
    """
    drawn = [one.shaped.candidate for one in settled if is_drawn(one)]
    if not drawn:
        return race.best(size)
    for subset in race.sets(size):
        further = [
            race.search.projection.candidates[number].candidate
            for number in subset.numbers[len(settled) :]
        ]
        if not any(_of_shape(one, shape) for one in further for shape in drawn):
            return subset
    return None


def _of_shape(law: Candidate, drawn: Candidate) -> bool:
    return law.joint == drawn.joint and shape_of(law) is shape_of(drawn)


def judged_beside(
    search: Search, subset: Subset, settled: Sequence[Judged], thresholds: Thresholds
) -> list[Judged]:
    """The effects of a set. Those that are `settled` are weighed anew as kinds or, beside a shape
    that was drawn, stay as they are: their laws were weighed. A scale may have made way for another
    one, as scales of several joints come to the same.
    """
    found, known = all_judged(search, subset, thresholds), len(settled)
    if any(is_drawn(one) for one in settled):
        stay = [
            old if old.shaped.candidate == new.shaped.candidate else new
            for old, new in zip(settled, found[:known], strict=True)
        ]
        return [*stay, *found[known:]]
    return as_kinds(search, found, known, thresholds)
