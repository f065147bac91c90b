"""What the machines of a site are made of, and which laws of effects they can hide."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from crane_benchmark.away.families import FAMILIES
from crane_benchmark.cases.case import Case, EffectToHide, Site
from crane_model.machine import Machine
from crane_sim.effects.form import Form, Planted
from crane_sim.effects.forms import FORMS
from crane_sim.hiding.calibrate import draw_one
from crane_sim.parts.parameters import StandIn, load_stand_in
from crane_sim.parts.variation import vary, vary_valves
from crane_sim.plant.machine_in_motion import Build
from crane_sim.plant.plant import Plant

SPREAD = 0.15  # of the machines' parameters at home

LAWS: Mapping[Site, Mapping[str, Sequence[Form]]] = {Site.HOME: FORMS, Site.AWAY: FAMILIES}
"""Of each site: effect to the laws that its machines have of it."""


def drawn_machine(case: Case, machine: Machine, seed: int) -> tuple[StandIn, Build]:
    """The parameters of the machine of a case, and what makes it."""
    if case.site is Site.AWAY:
        # only here: MuJoCo is an extra, which machines at home do not need
        from crane_benchmark.away.drawn_machine import drawn_away

        return drawn_away(load_stand_in(), machine, seed)
    stand_in = vary(load_stand_in(), seed, SPREAD)
    if case.spools:
        stand_in = vary_valves(stand_in, machine, seed)
    return stand_in, partial(Plant, stand_in, machine)


def drawn_effects(
    site: Site, effects: Sequence[EffectToHide], stand_in: StandIn, seed: int
) -> tuple[Planted, ...]:
    """The effects with parameters that are given or drawn, each magnitude at its start."""
    planted = []
    for index, one in enumerate(effects):
        form = next(form for form in LAWS[site][one.effect] if form.name == one.form)
        wanted = Planted(form, one.joint, (), one.strength)
        rng = np.random.default_rng([seed, index])
        planted.append(draw_one(rng, stand_in, wanted, one.parameters))
    return tuple(planted)
