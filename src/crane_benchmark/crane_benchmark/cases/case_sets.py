"""Which cases a set holds: what is hidden in each, how strong, and how well it is excited."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import cycle
from typing import Any

import numpy as np

from crane_benchmark.cases.case import (
    Carried,
    Case,
    CaseKind,
    EffectToHide,
    Simulator,
    World,
)
from crane_benchmark.cases.motions import LABORATORY_CRANE, PLANAR_JOINTS, Richness
from crane_benchmark.cases.simulators import LAWS
from crane_sim.effects.form import Form
from crane_sim.effects.kernel import FORMS

Laws = Mapping[str, Sequence[Form]]
"""Effect to the laws of it."""

ABSORBED = ("pressure_gain",)  # by the masses: no data without a known weight show it
LOAD = "payload"  # in all recordings it would be a link's mass
# rms over that of the drive force, of single effects
RELATIVE_MAGNITUDES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
UNKNOWN = (0.02, 0.04, 0.08)  # of effects outside the catalogue
PAIR = 0.04  # of either effect of a pair
LACKS = ("coulomb_asymmetry",)  # of the telescope, where a model lacks a class of equal effects
CONSTANT_FORCES = ("coulomb_asymmetry", "offset", "pressure_offset")  # of the telescope
FAINT = ("actuator_inertia", "boom_flexibility", "time_skew")  # that slow motion hides
SHARES = {
    CaseKind.NOTHING: 0.2,
    CaseKind.LENGTHS: 0.05,
    CaseKind.OUTSIDE: 0.15,
    CaseKind.PAIR: 0.15,
    CaseKind.AMBIGUOUS: 0.04,
    CaseKind.INSUFFICIENT: 0.04,
    CaseKind.SINGLE: 0.37,
}
COLD = ("warm_up",)  # effects of the first minutes, that recordings of a session do not show


def drawn(
    rng: np.random.Generator, outside: bool, magnitudes: Sequence[float], laws: Laws = FORMS
) -> Iterator[EffectToHide]:
    """Effects on joints in random order, equally often, at all magnitudes in turn."""
    places = sorted(
        {
            (form.effect, joint or "")
            for forms in laws.values()
            for form in forms
            if form.outside is outside and form.effect not in ABSORBED
            for joint in form.where.joints(LABORATORY_CRANE) or (None,)
        }
    )
    magnitude = cycle(magnitudes)
    while True:
        for place in rng.permutation(len(places)):
            effect, joint = places[place]
            yield in_any_form(rng, effect, joint or None, next(magnitude), laws)


def in_any_form(
    rng: np.random.Generator, effect: str, joint: str | None, magnitude: float, laws: Laws = FORMS
) -> EffectToHide:
    """The effect in any of its forms that can act there."""
    forms = [
        form.name
        for form in laws[effect]
        if joint is None or joint in form.where.joints(LABORATORY_CRANE)
    ]
    return EffectToHide(
        effect=effect,
        joint=joint,
        form=str(rng.choice(forms)),
        relative_magnitude=magnitude,
        carried=Carried.LATER if effect == LOAD else Carried.ALL,
    )


def field(rng: np.random.Generator) -> dict[str, Any]:
    """Draw what a case of the field has besides the injected effects."""
    warm, spools = (rng.uniform(size=2) < 0.5).tolist()
    return {"world": World.FIELD, "warm": warm, "spools": spools}


class CaseSet(StrEnum):
    """Cases of different sets share no seed, no machine and no trajectory."""

    TUNING = "tuning"  # to find out what a diagnosis gets wrong
    CALIBRATION = "calibration"  # nothing hidden, half in the field: to set thresholds
    SCORING = "scoring"  # half of each simulator; once for each set of thresholds
    FORMER = "former"  # scored with the thresholds before these; for tuning since
    INDEPENDENT_TUNING = "independent_tuning"  # as tuning, of machines of other make
    INDEPENDENT_CLEAN = "independent_clean"  # as calibration, of machines of other make


SET_SEEDS = {
    CaseSet.TUNING: 0,
    CaseSet.CALIBRATION: 1,
    CaseSet.FORMER: 21,
    CaseSet.SCORING: 22,
    CaseSet.INDEPENDENT_TUNING: 12,
    CaseSet.INDEPENDENT_CLEAN: 13,
}
"""Before new thresholds are locked, the scoring set becomes the former one and gets a new seed."""


def cases(which: CaseSet, count: int) -> list[Case]:
    """The cases of a set, in an order that tells nothing."""
    seeds = [(SET_SEEDS[which], k) for k in range(count)]
    if which is CaseSet.CALIBRATION:
        made = [_null(seed, Simulator.PRIMARY) for seed in seeds]
    elif which is CaseSet.INDEPENDENT_CLEAN:
        made = [_null(seed, Simulator.INDEPENDENT) for seed in seeds]
    elif which is CaseSet.INDEPENDENT_TUNING:
        made = _hiding(seeds, Simulator.INDEPENDENT)
    elif which in (CaseSet.SCORING, CaseSet.FORMER):
        made = _hiding(seeds[::2], Simulator.PRIMARY) + _hiding(seeds[1::2], Simulator.INDEPENDENT)
    else:
        made = _hiding(seeds, Simulator.PRIMARY)
    return sorted(made, key=lambda case: case.name)


def with_others(case: Case, number: int) -> Case:
    """The case with other effects of the same kind and magnitude, drawn `number` times."""
    rng = np.random.default_rng([20261121, *case.seed, number])
    magnitudes = [effect.relative_magnitude for effect in case.effects]
    candidates = drawn(rng, case.kind is CaseKind.OUTSIDE, magnitudes, LAWS[case.simulator])
    old = {effect.effect for effect in case.effects}
    if case.world is World.FIELD:
        old.update(COLD)
    effects: list[EffectToHide] = []
    for wanted in case.effects:
        replacement = next(candidate for candidate in candidates if candidate.effect not in old)
        effects.append(
            replacement.model_copy(update={"relative_magnitude": wanted.relative_magnitude})
        )
        old.add(replacement.effect)
    return case.model_copy(update={"effects": tuple(effects)})


def apportioned(shares: dict[CaseKind, float], count: int) -> dict[CaseKind, int]:
    """`count` split by the largest remainders."""
    whole = {kind: int(share * count) for kind, share in shares.items()}
    left = sorted(shares, key=lambda kind: whole[kind] - shares[kind] * count)
    for kind in left[: count - sum(whole.values())]:
        whole[kind] += 1
    return whole


def _null(seed: tuple[int, int], simulator: Simulator) -> Case:
    """Nothing hidden, every other time in the field."""
    rng = np.random.default_rng([20261121, *seed])
    return Case(
        name=_name(seed),
        kind=CaseKind.NOTHING,
        simulator=simulator,
        seed=seed,
        **(field(rng) if seed[1] % 2 else {"spools": _even(rng)}),
    )


def _hiding(seeds: list[tuple[int, int]], simulator: Simulator) -> list[Case]:
    """Cases of all kinds in their shares; of those with designed and rich motions every other one
    is of the field.

    Every other machine that hides an effect has not the lengths of its file.
    """
    if not seeds:
        return []
    rng, laws = np.random.default_rng([20261121, seeds[0][0], len(simulator)]), LAWS[simulator]
    kinds = [kind for kind, n in apportioned(SHARES, len(seeds)).items() for _ in range(n)]
    single, pair = drawn(rng, False, RELATIVE_MAGNITUDES, laws), drawn(rng, False, (PAIR,), laws)
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
        elif kind is CaseKind.AMBIGUOUS and number % 2:
            effects = (in_any_form(rng, "pressure_offset", "telescope", PAIR, laws),)
        elif kind is CaseKind.INSUFFICIENT:
            faint = str(rng.choice([effect for effect in FAINT if effect in laws] or list(laws)))
            effects = (in_any_form(rng, faint, str(rng.choice(PLANAR_JOINTS)), PAIR, laws),)
        poor = kind is CaseKind.INSUFFICIENT
        in_field = not poor and number % 2 and all(effect.effect not in COLD for effect in effects)
        off = number % 4 > 1 if effects else kind is CaseKind.LENGTHS
        out.append(
            Case(
                name=_name(seed),
                kind=kind,
                simulator=simulator,
                seed=seed,
                effects=effects,
                excitation=Richness.POOR if poor else Richness.RICH,
                lacks=LACKS if kind is CaseKind.AMBIGUOUS else (),
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
    return first, next(effect for effect in pair if effect.effect != first.effect)


def _name(seed: tuple[int, int]) -> str:
    return hashlib.blake2b("{}/{}".format(*seed).encode(), digest_size=5).hexdigest()
