"""Which cases a set holds: what is hidden in each, how strong, and how well it is excited."""

import hashlib
from collections.abc import Iterator
from enum import StrEnum

import numpy as np

from crane_benchmark.cases.case import Case, CaseKind, EffectToHide, Site, World
from crane_benchmark.cases.drawn import drawn, in_any_form
from crane_benchmark.cases.joints import PLANAR_JOINTS
from crane_benchmark.cases.motions import Richness
from crane_benchmark.cases.sites import LAWS
from crane_benchmark.cases.strangers import field, stranger

STRENGTHS = (0.005, 0.01, 0.02, 0.04, 0.08)  # of single effects: rms over that of the drive force
UNKNOWN = (0.02, 0.04, 0.08)  # of effects outside the catalogue
PAIR = 0.04  # of either effect of a pair
LACKS = ("coulomb_asymmetry",)  # of the telescope, where a model lacks a class of equal effects
TWINS = ("coulomb_asymmetry", "offset", "pressure_offset")  # constant forces of the telescope
FAINT = ("actuator_inertia", "boom_flexibility", "time_skew")  # that slow motion hides


class CaseSet(StrEnum):
    """Cases of different sets share no seed, no machine and no trajectory."""

    TUNING = "tuning"  # to find out what a diagnosis gets wrong
    CALIBRATION = "calibration"  # nothing hidden, half in the field: to set thresholds
    SCORING = "scoring"  # once for each set of thresholds
    FORMER = "former"  # scored with the thresholds before these; for tuning since
    STRANGERS = "strangers"  # in the field: what a diagnosis once got wrong there
    AWAY = "away"  # of machines of other make, half in the field
    AWAY_CLEAN = "away_clean"  # the same, nothing hidden


SEEDS = {
    CaseSet.TUNING: 0,
    CaseSet.CALIBRATION: 1,
    CaseSet.FORMER: 5,
    CaseSet.SCORING: 6,
    CaseSet.STRANGERS: 7,
    CaseSet.AWAY: 12,
    CaseSet.AWAY_CLEAN: 13,
}
"""Before new thresholds are frozen, the scoring set becomes the former one and gets a new seed."""

SHARES = {
    CaseKind.NOTHING: 0.25,
    CaseKind.OUTSIDE: 0.15,
    CaseKind.PAIR: 0.15,
    CaseKind.CLASS: 0.05,
    CaseKind.INSUFFICIENT: 0.05,
    CaseKind.SINGLE: 0.35,
}
AWAY_SHARES = {
    CaseKind.NOTHING: 0.2,
    CaseKind.OUTSIDE: 0.15,
    CaseKind.PAIR: 0.15,
    CaseKind.SINGLE: 0.5,
}
COLD = ("warm_up",)  # effects of the first minutes, that recordings of a session do not show


def cases(which: CaseSet, count: int) -> list[Case]:
    """The cases of a set, in an order that tells nothing."""
    seeds = [(SEEDS[which], k) for k in range(count)]
    if which is CaseSet.STRANGERS:
        made = [stranger(_name(seed), seed) for seed in seeds]
    elif which is CaseSet.CALIBRATION:
        made = [_null(seed) for seed in seeds]
    elif which is CaseSet.AWAY_CLEAN:
        made = [_null(seed).model_copy(update={"site": Site.AWAY}) for seed in seeds]
    elif which is CaseSet.AWAY:
        made = _away(seeds)
    else:
        made = _hiding(seeds)
    return sorted(made, key=lambda case: case.name)


def with_others(case: Case, number: int) -> Case:
    """The case with other effects of the same kind and strength, drawn for the `number`-th time."""
    if case.story is not None:
        told = stranger(case.name, case.seed, number)
        return told.model_copy(update={"excitation": case.excitation})
    rng = np.random.default_rng([20261121, *case.seed, number])
    strengths = [one.strength for one in case.effects]
    others = drawn(rng, case.kind is CaseKind.OUTSIDE, strengths, LAWS[case.site])
    old = {one.effect for one in case.effects}
    if case.world is World.FIELD:
        old.update(COLD)
    effects: list[EffectToHide] = []
    for wanted in case.effects:
        other = next(one for one in others if one.effect not in old)
        effects.append(other.model_copy(update={"strength": wanted.strength}))
        old.add(other.effect)
    return case.model_copy(update={"effects": tuple(effects)})


def apportioned(shares: dict[CaseKind, float], count: int) -> dict[CaseKind, int]:
    """`count` split by the largest remainders."""
    whole = {kind: int(share * count) for kind, share in shares.items()}
    left = sorted(shares, key=lambda kind: whole[kind] - shares[kind] * count)
    for kind in left[: count - sum(whole.values())]:
        whole[kind] += 1
    return whole


def _null(seed: tuple[int, int]) -> Case:
    """Nothing hidden, every other time in the field."""
    special = field(np.random.default_rng([20261121, *seed])) if seed[1] % 2 else {}
    return Case(name=_name(seed), kind=CaseKind.NOTHING, seed=seed, **special)


def _hiding(seeds: list[tuple[int, int]]) -> list[Case]:
    """Cases of all kinds in their shares, of the laboratory."""
    rng = np.random.default_rng([20261121, seeds[0][0]])
    kinds = [kind for kind, n in apportioned(SHARES, len(seeds)).items() for _ in range(n)]
    single, pair = drawn(rng, False, STRENGTHS), drawn(rng, False, (PAIR,))
    outside = drawn(rng, True, UNKNOWN)
    out = []
    for seed, kind in zip(seeds, kinds, strict=True):
        effects: tuple[EffectToHide, ...] = ()
        if kind is CaseKind.SINGLE:
            effects = (next(single),)
        elif kind is CaseKind.OUTSIDE:
            effects = (next(outside),)
        elif kind is CaseKind.PAIR:
            effects = _two(pair)
        elif kind is CaseKind.CLASS and seed[1] % 2:
            effects = (in_any_form(rng, "pressure_offset", "telescope", PAIR),)
        elif kind is CaseKind.INSUFFICIENT:
            faint = str(rng.choice(FAINT))
            effects = (in_any_form(rng, faint, str(rng.choice(PLANAR_JOINTS)), PAIR),)
        out.append(
            Case(
                name=_name(seed),
                kind=kind,
                seed=seed,
                effects=effects,
                excitation=Richness.POOR if kind is CaseKind.INSUFFICIENT else Richness.RICH,
                lacks=LACKS if kind is CaseKind.CLASS else (),
            )
        )
    return out


def _away(seeds: list[tuple[int, int]]) -> list[Case]:
    """Cases of machines of other make in their shares, every other one of the field."""
    rng, laws = np.random.default_rng([20261121, seeds[0][0]]), LAWS[Site.AWAY]
    kinds = [kind for kind, n in apportioned(AWAY_SHARES, len(seeds)).items() for _ in range(n)]
    single, pair = drawn(rng, False, STRENGTHS, laws), drawn(rng, False, (PAIR,), laws)
    outside = drawn(rng, True, UNKNOWN, laws)
    out = []
    for seed, kind in zip(seeds, kinds, strict=True):
        effects: tuple[EffectToHide, ...] = ()
        if kind is CaseKind.SINGLE:
            effects = (next(single),)
        elif kind is CaseKind.OUTSIDE:
            effects = (next(outside),)
        elif kind is CaseKind.PAIR:
            effects = _two(pair)
        designed = seed[1] % 2 == 0 or any(one.effect in COLD for one in effects)
        special = {} if designed else field(np.random.default_rng([20261121, *seed]))
        out.append(
            Case(name=_name(seed), kind=kind, site=Site.AWAY, seed=seed, effects=effects, **special)
        )
    return out


def _two(pair: Iterator[EffectToHide]) -> tuple[EffectToHide, EffectToHide]:
    """The next of them, and the next of another kind."""
    first = next(pair)
    return first, next(one for one in pair if one.effect != first.effect)


def _name(seed: tuple[int, int]) -> str:
    return hashlib.blake2b("{}/{}".format(*seed).encode(), digest_size=5).hexdigest()
