"""Which cases a set holds: what is hidden in each, how strong, and how well it is excited."""

import hashlib
from collections.abc import Iterator, Sequence
from enum import StrEnum
from itertools import cycle

import numpy as np
from motions import Excitation

from crane_model.configuration import Schema
from crane_model.machine import PLANAR_JOINTS
from crane_sim.hidden.forms import FORMS

STRENGTHS = (0.005, 0.01, 0.02, 0.04, 0.08)  # of single effects: rms over that of the drive force
UNKNOWN = (0.02, 0.04, 0.08)  # of effects outside the catalogue
PAIR = 0.04  # of either effect of a pair
LACKS = ("coulomb_asymmetry",)  # of the telescope, where a model lacks a class of equal effects
TWINS = ("coulomb_asymmetry", "offset", "pressure_offset")  # constant forces of the telescope
ABSORBED = ("pressure_gain",)  # by the masses: no data without a known weight show it
FAINT = ("actuator_inertia", "boom_flexibility", "time_skew")  # that slow motion hides


class CaseSet(StrEnum):
    """Cases of different sets share no seed, no machine and no trajectory."""

    TUNING = "tuning"  # to find out what a diagnosis gets wrong
    CALIBRATION = "calibration"  # nothing hidden: to set thresholds
    SCORING = "scoring"  # once for each set of thresholds
    FORMER = "former"  # scored with the thresholds before these; for tuning since


SEEDS = {CaseSet.TUNING: 0, CaseSet.CALIBRATION: 1, CaseSet.FORMER: 4, CaseSet.SCORING: 5}
"""Before new thresholds are frozen, the scoring set becomes the former one and gets a new seed."""


class Kind(StrEnum):
    """What sort of case it is; the value is what tables say."""

    NOTHING = "nothing"
    OUTSIDE = "outside the catalogue"
    PAIR = "pair"
    CLASS = "twins"  # effects that no data of this kind tell apart
    INSUFFICIENT = "too little data"
    SINGLE = "single"


SHARES = {
    Kind.NOTHING: 0.25,
    Kind.OUTSIDE: 0.15,
    Kind.PAIR: 0.15,
    Kind.CLASS: 0.05,
    Kind.INSUFFICIENT: 0.05,
    Kind.SINGLE: 0.35,
}


class Hidden(Schema):
    """An effect to hide in a form of the stand-in machine; `joint` None is the whole machine."""

    effect: str
    joint: str | None
    form: str
    strength: float


class Case(Schema):
    """One case. `seed` is that of machine, motions and sensors; `lacks` are types of terms that
    the model to diagnose lacks on the telescope.
    """

    name: str  # tells nothing
    kind: Kind
    seed: tuple[int, int]
    effects: tuple[Hidden, ...] = ()
    excitation: Excitation = Excitation.RICH
    lacks: tuple[str, ...] = ()


def cases(which: CaseSet, count: int) -> list[Case]:
    """The cases of a set, in an order that tells nothing. Those of CALIBRATION hide nothing."""
    number = SEEDS[which]
    rng = np.random.default_rng([20261121, number])
    if which is CaseSet.CALIBRATION:
        kinds = [Kind.NOTHING] * count
    else:
        kinds = [kind for kind, n in apportioned(SHARES, count).items() for _ in range(n)]
    single, pair = _drawn(rng, False, STRENGTHS), _drawn(rng, False, (PAIR,))
    outside = _drawn(rng, True, UNKNOWN)
    out = []
    for k, kind in enumerate(kinds):
        effects: tuple[Hidden, ...] = ()
        if kind is Kind.SINGLE:
            effects = (next(single),)
        elif kind is Kind.OUTSIDE:
            effects = (next(outside),)
        elif kind is Kind.PAIR:
            first = next(pair)
            effects = (first, next(one for one in pair if one.effect != first.effect))
        elif kind is Kind.CLASS and k % 2:
            effects = (_hidden(rng, "pressure_offset", "telescope", PAIR),)
        elif kind is Kind.INSUFFICIENT:
            faint = str(rng.choice(FAINT))
            effects = (_hidden(rng, faint, str(rng.choice(PLANAR_JOINTS)), PAIR),)
        name = hashlib.blake2b(f"{number}/{k}".encode(), digest_size=5).hexdigest()
        out.append(
            Case(
                name=name,
                kind=kind,
                seed=(number, k),
                effects=effects,
                excitation=Excitation.POOR if kind is Kind.INSUFFICIENT else Excitation.RICH,
                lacks=LACKS if kind is Kind.CLASS else (),
            )
        )
    return sorted(out, key=lambda case: case.name)


def with_others(case: Case, number: int) -> Case:
    """The case with other effects of the same kind and strength, drawn for the `number`-th time."""
    rng = np.random.default_rng([20261121, *case.seed, number])
    drawn = _drawn(rng, case.kind is Kind.OUTSIDE, [one.strength for one in case.effects])
    old = {one.effect for one in case.effects}
    effects: list[Hidden] = []
    for wanted in case.effects:
        other = next(one for one in drawn if one.effect not in old)
        effects.append(other.model_copy(update={"strength": wanted.strength}))
        old.add(other.effect)
    return case.model_copy(update={"effects": tuple(effects)})


def apportioned(shares: dict[Kind, float], count: int) -> dict[Kind, int]:
    """`count` split by the largest remainders."""
    whole = {kind: int(share * count) for kind, share in shares.items()}
    left = sorted(shares, key=lambda kind: whole[kind] - shares[kind] * count)
    for kind in left[: count - sum(whole.values())]:
        whole[kind] += 1
    return whole


def _drawn(rng: np.random.Generator, outside: bool, strengths: Sequence[float]) -> Iterator[Hidden]:
    """Effects on joints in random order, each as often as any other, at all strengths in turn."""
    places = sorted(
        {
            (form.effect, joint or "")
            for forms in FORMS.values()
            for form in forms
            if form.outside is outside and form.effect not in ABSORBED
            for joint in form.joints or (None,)
        }
    )
    strength = cycle(strengths)
    while True:
        for place in rng.permutation(len(places)):
            effect, joint = places[place]
            yield _hidden(rng, effect, joint or None, next(strength))


def _hidden(rng: np.random.Generator, effect: str, joint: str | None, strength: float) -> Hidden:
    """The effect in any of its forms that can act there."""
    forms = [form.name for form in FORMS[effect] if joint is None or joint in form.joints]
    return Hidden(effect=effect, joint=joint, form=str(rng.choice(forms)), strength=strength)
