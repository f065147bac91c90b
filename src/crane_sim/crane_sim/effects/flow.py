"""Hidden effects in the flow: the valve's spool, leakage past the piston, and what gives way.

They do not show in the forces, which are computed from measured pressures, but in the flow.
"""

import math

from numba import njit

from crane_sim.effects.form import Draw, Form, Magnitude
from crane_sim.effects.working import FLOW, LEAKS, SOFTNESS, Hidden
from crane_sim.parts.constants import Constants
from crane_sim.parts.hydraulics import conductances, opening, port_flow
from crane_sim.parts.state import State

SOFT_OVERLAP, PLAY, TWO_GAINS = range(FLOW, FLOW + 3)
ORIFICE_LEAK = LEAKS
HOSE_WALL, AIR = range(SOFTNESS, SOFTNESS + 2)

NO_BRANCH = "a law of the flow has no branch in effects/flow.py: give it one"

ATMOSPHERE = 1.013e5  # Pa
LAMINAR = 5e5  # Pa, below it a leak is laminar


@njit(cache=True, error_model="numpy", inline="always")
def meter(hidden: Hidden, constants: Constants, state: State, i: int) -> float:
    """Metering opening -1..1 of the valve of joint i; notes what the effects change in its flow."""
    valve, actuator = constants.valves[i], state.actuators[i]
    spool = actuator.spool - valve.null
    x = opening(spool, valve.dead_zone)
    for k in range(len(hidden.law)):
        law, value = hidden.law[k], hidden.value[k]
        if hidden.joint[k] != i or not FLOW <= law < LEAKS:
            continue
        before = x
        if law == SOFT_OVERLAP:
            x = math.copysign(_past(abs(x), value[0], value[1]), x)
        elif law == PLAY:  # the edges trail the spool
            half, memory = 0.5 * value[0], hidden.memory[k]
            memory[0] = min(max(memory[0], spool - half), spool + half)
            x = opening(memory[0], valve.dead_zone)
        elif law == TWO_GAINS:
            x *= 1.0 + value[0] * math.tanh(x / value[1])
        else:
            raise ValueError(NO_BRANCH)
        open_now, open_before = conductances(valve, x)[0], conductances(valve, before)[0]
        flow, _ = port_flow(constants.oil, open_now, state.supply[0], actuator.p_a)
        former, _ = port_flow(constants.oil, open_before, state.supply[0], actuator.p_a)
        hidden.flow[k, i] = flow - former
    return x


@njit(cache=True, error_model="numpy")
def _past(x: float, band: float, corner: float) -> float:
    """x - band where x is far beyond band, nil at x = 0, smooth in between."""
    return 0.5 * (math.hypot(x - band, corner) + x - band - math.hypot(band, corner) + band)


@njit(cache=True, error_model="numpy")
def leak(hidden: Hidden, constants: Constants, state: State, i: int) -> float:
    """Conductance past the piston of joint i [m3/s/Pa]; notes the flow of the effects."""
    total = constants.cylinders[i].leakage
    drop = state.actuators[i].p_a - state.actuators[i].p_b
    for k in range(len(hidden.law)):
        if hidden.joint[k] == i and LEAKS <= hidden.law[k] < SOFTNESS:
            if hidden.law[k] != ORIFICE_LEAK:
                raise ValueError(NO_BRANCH)
            extra = hidden.value[k, 0] / math.sqrt(math.hypot(drop, LAMINAR))
            hidden.flow[k, i] = -extra * drop
            total += extra
    return total


@njit(cache=True, error_model="numpy")
def softness(hidden: Hidden, constants: Constants, i: int, pressure: float) -> float:
    """How much softer a chamber of joint i is than with the oil alone: a factor of at least 1."""
    total = 1.0
    for k in range(len(hidden.law)):
        if hidden.joint[k] == i and hidden.law[k] >= SOFTNESS:
            total += _compliance(hidden, k, constants, pressure)
    return total


@njit(cache=True, error_model="numpy")
def note_softness(
    hidden: Hidden, constants: Constants, i: int, pressure: float, volume: float, rate: float
) -> None:
    """Flow into a chamber A of `volume` [m3] whose pressure rises at `rate` [Pa/s]."""
    for k in range(len(hidden.law)):
        if hidden.joint[k] == i and hidden.law[k] >= SOFTNESS:
            softer = _compliance(hidden, k, constants, pressure)
            hidden.flow[k, i] = softer * volume / constants.oil.bulk_modulus * rate


@njit(cache=True, error_model="numpy")
def _compliance(hidden: Hidden, k: int, constants: Constants, pressure: float) -> float:
    """Beyond that of the oil, in units of it."""
    size = hidden.value[k, 0]
    if hidden.law[k] == HOSE_WALL:  # stretches less under pressure
        return size / (1.0 + max(pressure, 0.0) / hidden.value[k, 1])
    if hidden.law[k] == AIR:  # a share of the volume at atmospheric pressure, isothermal
        absolute = max(pressure, 0.0) + ATMOSPHERE
        return size * constants.oil.bulk_modulus * ATMOSPHERE / (absolute * absolute)
    raise ValueError(NO_BRANCH)


FORMS = (
    Form("valve_dead_zone", "soft_overlap", SOFT_OVERLAP, Magnitude("band", "1", 0.02, 0.4),
         (Draw("corner", "1", 0.003, 0.01),)),
    Form("valve_hysteresis", "trailing_edges", PLAY, Magnitude("width", "1", 0.02, 0.4)),
    Form("valve_asymmetry", "two_gains", TWO_GAINS, Magnitude("share", "1", 0.05, 0.8),
         (Draw("corner", "1", 0.003, 0.01),), signed=True),
    Form("internal_leakage", "orifice", ORIFICE_LEAK,
         Magnitude("conductance", "m3/(s Pa^0.5)", 1e-9, 1e-7)),
    Form("oil_compressibility", "hose_wall", HOSE_WALL, Magnitude("softness", "1", 0.5, 40.0),
         (Draw("stiffening", "Pa", 1e7, 4e7),)),
    Form("air_in_oil", "isothermal", AIR, Magnitude("share", "1", 0.01, 0.5), outside=True),
)  # fmt: skip
