"""Machines at home, drawn: the stand-in with other parameters."""

from functools import partial

import numpy as np

from crane_model.machine import Machine
from crane_sim.parts.parameters import StandIn
from crane_sim.parts.variation import vary, vary_hydraulics, vary_sensors, vary_valves
from crane_sim.plant.machine_in_motion import Build
from crane_sim.plant.plant import Plant

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
