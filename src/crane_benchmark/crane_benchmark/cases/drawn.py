"""Effects to hide, drawn from all that the stand-in machine can hide."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from crane_benchmark.cases.case import Carried, Case, CaseKind, EffectToHide, Story, World
from crane_benchmark.cases.motions import LABORATORY_CRANE, PLANAR_JOINTS
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


# Stories of machines of another make, of which a diagnosis once said what is not so.

STORIES = (
    *(Story.LOAD,) * 3,
    *(Story.WARMING,) * 2,
    *(Story.STRONG,) * 2,
    *(Story.ONCE,) * 2,
    *(Story.SPOOLS,) * 2,
    Story.NOTHING,
)
CLEAR, STRONG = 0.04, 0.08  # rms over that of the drive force
LOADS = (0.02, 0.04, 0.08)
WARMING = (300.0, 1200.0)  # s, time constant of the oil; a session takes some 40 minutes
ZONE = 0.3  # rad, m, before the ends of the stroke
IN_FORCE = ("stribeck", "load_friction", "seal_friction", "viscous_quadratic", "hose_stiffness")
IN_FLOW = ("valve_hysteresis", "internal_leakage", "oil_compressibility")


def field(rng: np.random.Generator) -> dict[str, Any]:
    """What a case of the field has beside what is hidden."""
    warm, spools = (rng.uniform(size=2) < 0.5).tolist()
    return {"world": World.FIELD, "warm": warm, "spools": spools}


def stranger(name: str, seed: tuple[int, int], number: int = 0) -> Case:
    """The case of this `seed`, whose effects are drawn for the `number`-th time."""
    rng = np.random.default_rng([20261121, *seed, number])
    place = seed[1] % len(STORIES)
    story = STORIES[place]
    which = place - STORIES.index(story)  # of the cases that tell it
    kind, effects, special = TELL[story](rng, which)
    given = field(rng) | {"kind": kind, "effects": effects, "story": story} | special
    return Case(name=name, seed=seed, **given)


Told = tuple[CaseKind, tuple[EffectToHide, ...], dict[str, Any]]
"""Kind, what is hidden, and what else is special."""


def _load(rng: np.random.Generator, which: int) -> Told:
    load = in_any_form(rng, LOAD, None, LOADS[which])
    return CaseKind.SINGLE, (load.model_copy(update={"carried": Carried.SOME}),), {}


def _warming(rng: np.random.Generator, which: int) -> Told:
    viscosity = in_any_form(rng, "warm_up", _joint(rng), STRONG)
    warming = round(float(rng.uniform(*WARMING)), 1)
    viscosity = viscosity.model_copy(update={"parameters": {"warming": warming}})
    return CaseKind.SINGLE, (viscosity,), {"warm": which == 1}


def _strong(rng: np.random.Generator, which: int) -> Told:
    effect = "end_cushioning" if which == 0 else str(rng.choice(IN_FORCE))
    hidden = in_any_form(rng, effect, _joint(rng), STRONG)
    if which == 0:  # a zone that most motions enter
        hidden = hidden.model_copy(update={"parameters": {"zone": ZONE}})
    return CaseKind.SINGLE, (hidden,), {}


def _once(rng: np.random.Generator, which: int) -> Told:
    """Friction in waves alone, of which nothing shows in what is held out; or the zero of an
    encoder, beside an effect that all recordings carry.
    """
    once = {"carried": Carried.ONE}
    if which == 0:
        waves = in_any_form(rng, "cyclic_friction", _joint(rng), STRONG)
        return CaseKind.OUTSIDE, (waves.model_copy(update=once),), {}
    zero = in_any_form(rng, "encoder_offset", str(rng.choice(PLANAR_JOINTS[:2])), CLEAR)
    other = in_any_form(rng, str(rng.choice(IN_FORCE)), _joint(rng), CLEAR)
    return CaseKind.PAIR, (other, zero.model_copy(update=once)), {}


def _spools(rng: np.random.Generator, which: int) -> Told:
    effect = str(rng.choice(IN_FORCE if which == 0 else IN_FLOW))
    return CaseKind.SINGLE, (in_any_form(rng, effect, _joint(rng), CLEAR),), {"spools": True}


def _nothing(rng: np.random.Generator, which: int) -> Told:
    return CaseKind.NOTHING, (), {"spools": True}


def _joint(rng: np.random.Generator) -> str:
    return str(rng.choice(PLANAR_JOINTS))


TELL: dict[Story, Callable[[np.random.Generator, int], Told]] = {
    Story.LOAD: _load,
    Story.WARMING: _warming,
    Story.STRONG: _strong,
    Story.ONCE: _once,
    Story.SPOOLS: _spools,
    Story.NOTHING: _nothing,
}
