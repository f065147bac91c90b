"""Effects to hide, drawn from all that the stand-in machine can hide."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle

import numpy as np

from crane_benchmark.cases.case import Carried, EffectToHide
from crane_benchmark.cases.joints import LABORATORY_CRANE
from crane_sim.effects.form import Form
from crane_sim.effects.forms import FORMS

Laws = Mapping[str, Sequence[Form]]
"""Effect to the laws of it."""

ABSORBED = ("pressure_gain",)  # by the masses: no data without a known weight show it
LOAD = "payload"  # in all recordings it would be a link's mass


def drawn(
    rng: np.random.Generator, outside: bool, strengths: Sequence[float], laws: Laws = FORMS
) -> Iterator[EffectToHide]:
    """Effects on joints in random order, each as often as any other, at all strengths in turn."""
    places = sorted(
        {
            (form.effect, joint or "")
            for forms in laws.values()
            for form in forms
            if form.outside is outside and form.effect not in ABSORBED
            for joint in form.where.joints(LABORATORY_CRANE) or (None,)
        }
    )
    strength = cycle(strengths)
    while True:
        for place in rng.permutation(len(places)):
            effect, joint = places[place]
            yield in_any_form(rng, effect, joint or None, next(strength), laws)


def in_any_form(
    rng: np.random.Generator,
    effect: str,
    joint: str | None,
    strength: float,
    laws: Laws = FORMS,
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
        strength=strength,
        carried=Carried.LATER if effect == LOAD else Carried.ALL,
    )
