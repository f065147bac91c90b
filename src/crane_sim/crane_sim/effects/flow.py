"""Injected effects in the flow: the valve's spool, leakage past the piston, and what gives way.

They do not show in the forces, which are computed from measured pressures, but in the flow.
"""

import math

import numpy as np
from numba import njit

from crane_sim.effects.form import FLOW, LEAKS, SOFTNESS, Draw, Form, Injected, Magnitude
from crane_sim.parts.constants import Constants, State
from crane_sim.parts.cylinders import conductances, opening, port_flow

(
    SOFT_OVERLAP, HARD_OVERLAP, UNEVEN_OVERLAP, PLAY, TWO_PLAYS, CREEPING_PLAY, TWO_GAINS, ONE_WAY,
    GRADUAL,
) = range(FLOW, FLOW + 9)  # fmt: skip
ORIFICE_LEAK, WIDENING_LEAK, WORN_LEAK = range(LEAKS, LEAKS + 3)
HOSE_WALL, BRAID, LONG_HOSE, AIR, FOAM, DISSOLVING = range(SOFTNESS, SOFTNESS + 6)

NO_BRANCH = "a law of the flow has no branch in effects/flow.py: give it one"

ATMOSPHERE_PA = 1.013e5
MAX_LAMINAR_PA = 5e5  # below it a leak is laminar
POLYTROPIC_EXPONENT = 1.3  # of foam


@njit(cache=True, error_model="numpy", inline="always")
def meter(injected: Injected, constants: Constants, state: State, i: int) -> float:
    """Metering opening -1..1 of the valve of joint i; notes what the effects change in its flow."""
    valve, actuator = constants.valves[i], state.actuators[i]
    spool = actuator.spool - valve.null
    x = opening(spool, valve.dead_band)
    for k in range(len(injected.law)):
        law = injected.law[k]
        if injected.joint[k] != i or not FLOW <= law < LEAKS:
            continue
        before = x
        if law < PLAY:
            x = math.copysign(_overlapped(law, injected.value[k], x), x)
        elif law < TWO_GAINS:
            x = opening(
                _trailing(law, injected.value[k], injected.memory[k], spool), valve.dead_band
            )
        else:
            x *= _gained(law, injected.value[k], x)
        open_now, open_before = conductances(valve, x)[0], conductances(valve, before)[0]
        flow, _ = port_flow(constants.oil, open_now, state.supply[0], actuator.p_a)
        former, _ = port_flow(constants.oil, open_before, state.supply[0], actuator.p_a)
        injected.flow[k, i] = flow - former
    return x


@njit(cache=True, error_model="numpy")
def _overlapped(law: int, value: np.ndarray, x: float) -> float:
    """Size of an opening x of edges that overlap more."""
    band = value[0]
    if law == SOFT_OVERLAP:
        corner = value[1]
        return _past(abs(x), band, corner)
    if law == UNEVEN_OVERLAP:  # more of it in one direction
        share = value[1]
        band *= 1.0 + math.copysign(share, x)
    return max(abs(x) - band, 0.0)


@njit(cache=True, error_model="numpy")
def _trailing(law: int, value: np.ndarray, memory: np.ndarray, spool: float) -> float:
    half, share = 0.5 * value[0], value[1]
    edges = min(max(memory[0], spool - half), spool + half)
    if law == TWO_PLAYS:  # one after the other
        inner = half * share
        memory[0], memory[1] = edges, min(max(memory[1], spool - inner), spool + inner)
        return 0.5 * (memory[0] + memory[1])
    if law != PLAY:
        edges += share * (spool - edges)  # each step of the plant
    memory[0] = edges
    return edges


@njit(cache=True, error_model="numpy")
def _gained(law: int, value: np.ndarray, x: float) -> float:
    """Factor of an opening x, whose gains differ."""
    difference, about = value[0], value[1]
    if law == TWO_GAINS:
        return 1.0 + difference * math.tanh(x / about)
    if law == ONE_WAY:
        return 1.0 + 2.0 * difference if x > 0.0 else 1.0
    if law == GRADUAL:
        return 1.0 + difference * x / (abs(x) + about)
    raise ValueError(NO_BRANCH)


@njit(cache=True, error_model="numpy")
def _past(x: float, band: float, corner: float) -> float:
    """x - band where x is far beyond band, nil at x = 0, smooth in between."""
    return 0.5 * (math.hypot(x - band, corner) + x - band - math.hypot(band, corner) + band)


@njit(cache=True, error_model="numpy", forceinline=True)
def leak(injected: Injected, constants: Constants, state: State, i: int) -> float:
    """Conductance past the piston of joint i [m3/s/Pa]; notes the flow of the effects."""
    total = constants.cylinders[i].leakage
    drop = state.actuators[i].p_a - state.actuators[i].p_b
    for k in range(len(injected.law)):
        if injected.joint[k] == i and LEAKS <= injected.law[k] < SOFTNESS:
            extra = injected.value[k, 0]
            if injected.law[k] == ORIFICE_LEAK:
                extra /= math.sqrt(math.hypot(drop, MAX_LAMINAR_PA))
            elif injected.law[k] == WIDENING_LEAK:
                widening = injected.value[k, 1]
                extra *= 1.0 + abs(drop) / widening
            elif injected.law[k] == WORN_LEAK:
                wear = injected.value[k, 1]
                place = (state.q[i] - injected.middle[k]) / injected.half[k]
                extra *= 1.0 + wear * math.exp(-4.0 * place * place)
            else:
                raise ValueError(NO_BRANCH)
            injected.flow[k, i] = -extra * drop
            total += extra
    return total


@njit(cache=True, error_model="numpy", forceinline=True)
def softness(injected: Injected, constants: Constants, i: int, pressure: float) -> float:
    """How much softer a chamber of joint i is than with the oil alone: a factor of at least 1."""
    total = 1.0
    for k in range(len(injected.law)):
        if injected.joint[k] == i and injected.law[k] >= SOFTNESS:
            total += _compliance(injected, k, constants, pressure)
    return total


@njit(cache=True, error_model="numpy", forceinline=True)
def note_softness(
    injected: Injected, constants: Constants, i: int, pressure: float, volume: float, rate: float
) -> None:
    """Flow into a chamber A of `volume` [m3] whose pressure rises at `rate` [Pa/s]."""
    for k in range(len(injected.law)):
        if injected.joint[k] == i and injected.law[k] >= SOFTNESS:
            softer = _compliance(injected, k, constants, pressure)
            injected.flow[k, i] = softer * volume / constants.oil.bulk_modulus * rate


@njit(cache=True, error_model="numpy", forceinline=True)
def _compliance(injected: Injected, k: int, constants: Constants, pressure: float) -> float:
    """Beyond that of the oil, in units of it."""
    law, size = injected.law[k], injected.value[k, 0]
    if law < AIR:  # walls that stretch less under pressure
        ratio = max(pressure, 0.0) / injected.value[k, 1]
        if law == HOSE_WALL:
            return size / (1.0 + ratio)
        return size * math.exp(-ratio) if law == BRAID else size / math.sqrt(1.0 + ratio)
    # a share of the volume at atmospheric pressure
    absolute = max(pressure, 0.0) + ATMOSPHERE_PA
    isothermal = size * constants.oil.bulk_modulus * ATMOSPHERE_PA / (absolute * absolute)
    if law == AIR:
        return isothermal
    if law == FOAM:
        return (
            isothermal
            * (absolute / ATMOSPHERE_PA) ** (1.0 - 1.0 / POLYTROPIC_EXPONENT)
            / POLYTROPIC_EXPONENT
        )
    if law == DISSOLVING:
        return isothermal * math.exp(-absolute / injected.value[k, 1])
    raise ValueError(NO_BRANCH)


_BAND, _WIDTH = Magnitude("band", "1", 0.02, 0.4), Magnitude("width", "1", 0.02, 0.4)
_CORNER = Draw("corner", "1", 0.003, 0.01)
_SHARE = Magnitude("share", "1", 0.05, 0.8)
_LEAK = Magnitude("conductance", "m3/(s Pa)", 1e-12, 1e-10)
_SOFTNESS, _STIFFENING = Magnitude("softness", "1", 0.5, 40.0), Draw("stiffening", "Pa", 1e7, 4e7)
_AIR = Magnitude("share", "1", 0.01, 0.5)

FLOW_FORMS = (
    Form("valve_dead_band", "soft_overlap", SOFT_OVERLAP, _BAND, (_CORNER,)),
    Form("valve_dead_band", "hard_overlap", HARD_OVERLAP, _BAND),
    Form("valve_dead_band", "uneven_overlap", UNEVEN_OVERLAP, _BAND,
         (Draw("lean", "1", -0.4, 0.4),)),
    Form("valve_hysteresis", "trailing_edges", PLAY, _WIDTH),
    Form("valve_hysteresis", "two_plays", TWO_PLAYS, _WIDTH, (Draw("inner", "1", 0.2, 0.7),)),
    Form("valve_hysteresis", "creeping_play", CREEPING_PLAY, _WIDTH,
         (Draw("creep", "1", 1e-5, 1e-4),)),
    Form("valve_asymmetry", "two_gains", TWO_GAINS, _SHARE, (_CORNER,), signed=True),
    Form("valve_asymmetry", "one_way", ONE_WAY, _SHARE._replace(highest=0.45), signed=True),
    Form("valve_asymmetry", "gradual", GRADUAL, _SHARE, (_CORNER,), signed=True),
    Form("internal_leakage", "orifice", ORIFICE_LEAK,
         Magnitude("conductance", "m3/(s Pa^0.5)", 1e-9, 1e-7)),
    Form("internal_leakage", "widening", WIDENING_LEAK, _LEAK,
         (Draw("widening", "Pa", 5e6, 2e7),)),
    Form("internal_leakage", "worn", WORN_LEAK, _LEAK, (Draw("middle", "1", 0.5, 3.0),)),
    Form("oil_compressibility", "hose_wall", HOSE_WALL, _SOFTNESS, (_STIFFENING,)),
    Form("oil_compressibility", "braid", BRAID, _SOFTNESS, (_STIFFENING,)),
    Form("oil_compressibility", "long_hose", LONG_HOSE, _SOFTNESS, (_STIFFENING,)),
    Form("air_in_oil", "isothermal", AIR, _AIR, outside=True),
    Form("air_in_oil", "foam", FOAM, _AIR, outside=True),
    Form("air_in_oil", "dissolving", DISSOLVING, _AIR, (Draw("dissolved", "Pa", 1e6, 4e6),),
         outside=True),
)  # fmt: skip
