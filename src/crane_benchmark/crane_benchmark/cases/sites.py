"""What the machines of a site are made of, and which laws of effects they can hide."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from crane_benchmark.away.families import FAMILIES
from crane_benchmark.cases.case import Case, EffectToHide, Site
from crane_model.machine import Machine
from crane_sim.effects.flaws import drawn_flaws
from crane_sim.effects.form import Form, Planted, SensorFault
from crane_sim.effects.forms import FORMS
from crane_sim.hiding.calibrate import draw_one
from crane_sim.parts.parameters import (
    StandIn,
    load_stand_in,
    vary,
    vary_geometry,
    vary_hydraulics,
    vary_sensors,
    vary_valves,
)
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Build

# Machines at home, drawn: the stand-in with other parameters.

SPREAD = 0.3  # of masses, friction and leakage
OF_VALVES = 0.15  # of spools, rated flows, hoses and supply line
OF_SENSORS = 0.3  # of noise and jitter
MODULUS = (1.15e9, 1.7e9)  # Pa, of oil as it is usual
STEPS = (1e-4, 2e-4)  # s, of the plant


def drawn_home(
    stand_in: StandIn, machine: Machine, seed: int, spools: bool
) -> tuple[StandIn, Build]:
    """A machine about `stand_in` and what makes it, in the geometry of `machine`.

    The valves have unequal edges where its `spools` are said to be so. The same seed gives the same
    one.
    """
    rng = np.random.default_rng([seed, 5])  # not the draws of `vary`
    drawn = vary_sensors(vary(stand_in, seed, SPREAD), seed, OF_SENSORS)
    drawn = vary_hydraulics(drawn, seed, OF_VALVES)
    oil = drawn.oil.model_copy(update={"bulk_modulus": float(rng.uniform(*MODULUS))})
    drawn = drawn.model_copy(update={"oil": oil, "step": float(rng.choice(STEPS))})
    if spools:
        drawn = vary_valves(drawn, machine, seed)
    return drawn, partial(Plant, drawn, machine)


SURVEYED = 0.002  # of the lengths of a machine whose file was measured on it: at most
AS_DRAWN = 0.03  # of one whose file is taken from drawings

LAWS: Mapping[Site, Mapping[str, Sequence[Form]]] = {Site.HOME: FORMS, Site.AWAY: FAMILIES}
"""Of each site: effect to the laws that its machines have of it."""


class DrawnMachine(NamedTuple):
    """The machine of a case."""

    stand_in: StandIn  # its parameters
    actual: Machine  # its geometry; that of the machine file is what a diagnosis is given
    build: Build  # what makes it
    flaws: tuple[SensorFault, ...]  # of its sensors


def drawn_machine(case: Case, machine: Machine, seed: int) -> DrawnMachine:
    """That of a case, about the one in the file `machine`."""
    actual = vary_geometry(machine, seed, AS_DRAWN if case.off else SURVEYED)
    flaws = drawn_flaws(machine, seed)
    if case.site is Site.AWAY:
        # only here: MuJoCo is an extra, which machines at home do not need
        from crane_benchmark.away.plant import drawn_away

        stand_in, build = drawn_away(load_stand_in(), actual, seed)
    else:
        stand_in, build = drawn_home(load_stand_in(), actual, seed, case.spools)
    return DrawnMachine(stand_in, actual, build, flaws)


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
