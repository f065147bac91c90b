"""Machines of the other make, drawn: parameters, valves, oil and pump."""

from functools import partial

import numpy as np

from crane_benchmark.away.parts import Make
from crane_benchmark.away.plant import AwayPlant
from crane_model.machine import Machine
from crane_sim.parts.parameters import StandIn
from crane_sim.parts.variation import vary, vary_hydraulics, vary_sensors, vary_valves
from crane_sim.plant.machine_in_motion import Build

SPREAD = 0.3  # of masses, friction and leakage
OF_VALVES = 0.15  # of spools, rated flows, hoses and supply line
OF_SENSORS = 0.3  # of noise and jitter
MODULUS = (1.2e9, 1.6e9)  # Pa, of the oil without pressure: with its air it stays usual
AIR = (2e-4, 1.5e-3)  # share of the volume at atmospheric pressure
STIFFENING = (3.0, 8.0)  # Pa per Pa
PUMP_LAG = (5e-3, 1.5e-2)  # s


def drawn_away(stand_in: StandIn, machine: Machine, seed: int) -> tuple[StandIn, Build]:
    """A machine about `stand_in` and what makes it, in the geometry of `machine`; the same seed
    gives the same one.
    """
    rng = np.random.default_rng([seed, 5])  # not the draws of `vary`
    drawn = vary_sensors(vary(stand_in, seed, SPREAD), seed, OF_SENSORS)
    drawn = vary_valves(vary_hydraulics(drawn, seed, OF_VALVES), machine, seed)
    oil = drawn.oil.model_copy(update={"bulk_modulus": float(rng.uniform(*MODULUS))})
    drawn = drawn.model_copy(update={"oil": oil})
    make = Make(
        air=float(rng.uniform(*AIR)),
        stiffening=float(rng.uniform(*STIFFENING)),
        pump_lag=float(rng.uniform(*PUMP_LAG)),
    )
    return drawn, partial(AwayPlant, drawn, machine, make)
