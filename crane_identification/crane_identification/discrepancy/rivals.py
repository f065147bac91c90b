"""Other effects in the place of one: what a set gains with them, and how alike they are to it."""

from collections.abc import Sequence

import numpy as np

from crane_identification.discrepancy.candidates import Family
from crane_identification.discrepancy.search import Search
from crane_identification.discrepancy.selection import NOTHING, Choice, extended, others, solve
from crane_identification.discrepancy.thresholds import Thresholds


def without(search: Search, choice: Choice, place: int) -> Choice:
    """The set without one of its effects."""
    rest = others(choice, place)
    return (solve(search.projection, rest) or NOTHING) if rest else NOTHING


def in_place_of(search: Search, choice: Choice, place: int) -> list[Choice]:
    """The set with each other family in the place of one of its effects, best first."""
    projection = search.projection
    family = projection.options[choice.options[place]].family
    replaced = extended(projection, without(search, choice, place))
    ranked = sorted(replaced, key=lambda one: -one.gain)
    return [one for one in ranked if projection.options[one.options[-1]].family != family]


def freedom(search: Search, number: int) -> int:
    """Number of parameters of an option, shapes included."""
    option = search.projection.options[number]
    return len(option.positive) + len(option.family.term.shapes)


def kin(one: Family, other: Family) -> bool:
    """Whether both are laws of the same effect, on the same joint."""
    return one.joint == other.joint and other.type in one.effect.kin


def likeness(search: Search, one: int, other: int) -> float:
    """Cosine of the smallest angle between the columns of two options, beside the base."""
    projection = search.projection
    a, b = projection.members[one], projection.members[other]
    gram = projection.gram
    if len(a) == len(b) == 1:
        return float(abs(gram[a[0], b[0]]))
    roots = [np.linalg.cholesky(gram[np.ix_(c, c)] + 1e-12 * np.eye(len(c))) for c in (a, b)]
    mixed = np.linalg.solve(roots[0], np.linalg.solve(roots[1], gram[np.ix_(b, a)]).T)
    return float(np.linalg.svd(mixed, compute_uv=False).min())


def same_as(
    search: Search, rivals: list[int], members: list[Family], thresholds: Thresholds
) -> list[Family]:
    """Further rivals whose columns are those of a member: they belong to the class as well."""
    options = search.projection.options
    known = [number for number in rivals if options[number].family in members]
    return [
        options[number].family
        for number in rivals
        if number not in known
        and any(likeness(search, number, one) > thresholds.alike for one in known)
    ]


def slight(channels: Sequence[np.ndarray], gains: Sequence[float], thresholds: Thresholds) -> bool:
    """Whether one of several effects gains too little beside another to be told from its form.

    `channels` are those where each acts. What a law leaves because it is not quite that of the
    machine is on its own joint, most of it.
    """
    where = [set(one.tolist()) for one in channels]
    for own, gain in zip(where, gains, strict=True):
        there = max(g for other, g in zip(where, gains, strict=True) if own & other)
        least = max(thresholds.further_share * there, thresholds.elsewhere_share * max(gains))
        if gain < least:
            return True
    return False
