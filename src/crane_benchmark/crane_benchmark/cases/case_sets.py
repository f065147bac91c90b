"""Which cases a set holds: what is hidden in each, how strong, and how well it is excited."""

import hashlib
from collections.abc import Iterator
from enum import StrEnum

import numpy as np

from crane_benchmark.cases.case import Case, CaseKind, EffectToHide, Site, World
from crane_benchmark.cases.drawn import drawn, field, in_any_form, stranger
from crane_benchmark.cases.motions import PLANAR_JOINTS, Richness
from crane_benchmark.cases.sites import LAWS

# rms over that of the drive force, of single effects
STRENGTHS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
UNKNOWN = (0.02, 0.04, 0.08)  # of effects outside the catalogue
PAIR = 0.04  # of either effect of a pair
LACKS = ("coulomb_asymmetry",)  # of the telescope, where a model lacks a class of equal effects
TWINS = ("coulomb_asymmetry", "offset", "pressure_offset")  # constant forces of the telescope
FAINT = ("actuator_inertia", "boom_flexibility", "time_skew")  # that slow motion hides


class CaseSet(StrEnum):
    """Cases of different sets share no seed, no machine and no trajectory."""

    TUNING = "tuning"  # to find out what a diagnosis gets wrong
    CALIBRATION = "calibration"  # nothing hidden, half in the field: to set thresholds
    SCORING = "scoring"  # half at home, half away; once for each set of thresholds
    FORMER = "former"  # scored with the thresholds before these; for tuning since
    STRANGERS = "strangers"  # in the field: what a diagnosis once got wrong there
    AWAY_TUNING = "away_tuning"  # as tuning, of machines of other make
    AWAY_CLEAN = "away_clean"  # as calibration, of machines of other make


SEEDS = {
    CaseSet.TUNING: 0,
    CaseSet.CALIBRATION: 1,
    CaseSet.FORMER: 21,
    CaseSet.SCORING: 22,
    CaseSet.STRANGERS: 7,
    CaseSet.AWAY_TUNING: 12,
    CaseSet.AWAY_CLEAN: 13,
}
"""Before new thresholds are frozen, the scoring set becomes the former one and gets a new seed."""

SHARES = {
    CaseKind.NOTHING: 0.2,
    CaseKind.LENGTHS: 0.05,
    CaseKind.OUTSIDE: 0.15,
    CaseKind.PAIR: 0.15,
    CaseKind.CLASS: 0.04,
    CaseKind.INSUFFICIENT: 0.04,
    CaseKind.SINGLE: 0.37,
}
COLD = ("warm_up",)  # effects of the first minutes, that recordings of a session do not show


def cases(which: CaseSet, count: int) -> list[Case]:
    """The cases of a set, in an order that tells nothing."""
    seeds = [(SEEDS[which], k) for k in range(count)]
    if which is CaseSet.STRANGERS:
        made = [stranger(_name(seed), seed) for seed in seeds]
    elif which is CaseSet.CALIBRATION:
        made = [_null(seed, Site.HOME) for seed in seeds]
    elif which is CaseSet.AWAY_CLEAN:
        made = [_null(seed, Site.AWAY) for seed in seeds]
    elif which is CaseSet.AWAY_TUNING:
        made = _hiding(seeds, Site.AWAY)
    elif which in (CaseSet.SCORING, CaseSet.FORMER):
        made = _hiding(seeds[::2], Site.HOME) + _hiding(seeds[1::2], Site.AWAY)
    else:
        made = _hiding(seeds, Site.HOME)
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


def _null(seed: tuple[int, int], site: Site) -> Case:
    """Nothing hidden, every other time in the field."""
    rng = np.random.default_rng([20261121, *seed])
    return Case(
        name=_name(seed),
        kind=CaseKind.NOTHING,
        site=site,
        seed=seed,
        **(field(rng) if seed[1] % 2 else {"spools": _even(rng)}),
    )


def _hiding(seeds: list[tuple[int, int]], site: Site) -> list[Case]:
    """Cases of all kinds in their shares; of those with designed and rich motions every other one
    is of the field.

    Every other machine that hides an effect has not the lengths of its file.
    """
    if not seeds:
        return []
    rng, laws = np.random.default_rng([20261121, seeds[0][0], len(site)]), LAWS[site]
    kinds = [kind for kind, n in apportioned(SHARES, len(seeds)).items() for _ in range(n)]
    single, pair = drawn(rng, False, STRENGTHS, laws), drawn(rng, False, (PAIR,), laws)
    outside = drawn(rng, True, UNKNOWN, laws)
    out = []
    for number, (seed, kind) in enumerate(zip(seeds, kinds, strict=True)):
        effects: tuple[EffectToHide, ...] = ()
        if kind is CaseKind.SINGLE:
            effects = (next(single),)
        elif kind is CaseKind.OUTSIDE:
            effects = (next(outside),)
        elif kind is CaseKind.PAIR:
            effects = _two(pair)
        elif kind is CaseKind.CLASS and number % 2:
            effects = (in_any_form(rng, "pressure_offset", "telescope", PAIR, laws),)
        elif kind is CaseKind.INSUFFICIENT:
            faint = str(rng.choice([one for one in FAINT if one in laws] or list(laws)))
            effects = (in_any_form(rng, faint, str(rng.choice(PLANAR_JOINTS)), PAIR, laws),)
        poor = kind is CaseKind.INSUFFICIENT
        in_field = not poor and number % 2 and all(one.effect not in COLD for one in effects)
        off = number % 4 > 1 if effects else kind is CaseKind.LENGTHS
        out.append(
            Case(
                name=_name(seed),
                kind=kind,
                site=site,
                seed=seed,
                effects=effects,
                excitation=Richness.POOR if poor else Richness.RICH,
                lacks=LACKS if kind is CaseKind.CLASS else (),
                off=bool(off),
                **(field(rng) if in_field else {"spools": _even(rng)}),
            )
        )
    return out


def _even(rng: np.random.Generator) -> bool:
    return bool(rng.uniform() < 0.5)


def _two(pair: Iterator[EffectToHide]) -> tuple[EffectToHide, EffectToHide]:
    """The next of them, and the next of another kind."""
    first = next(pair)
    return first, next(one for one in pair if one.effect != first.effect)


def _name(seed: tuple[int, int]) -> str:
    return hashlib.blake2b("{}/{}".format(*seed).encode(), digest_size=5).hexdigest()
