"""Steps of valves, oil, bristles and joints of the other make.

MuJoCo gives inertia and bias in the middle of some steps; within them oil and friction move on
in much shorter ones: pressures by exponential Euler, velocities before positions.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_benchmark.independent.effects import (
    PUSHING,
    IndependentEffects,
    Rubbed,
    beyond_dry,
    pushing,
    rubbing,
)
from crane_benchmark.independent.parts import (
    BRISTLE_DAMPING,
    MAKE_UP,
    IndependentParts,
    bent,
    edge,
    modulus,
    orifice,
    relaxed,
)
from crane_model.linkages import motion
from crane_sim.parts.borrowed import borrowed

LEAST_RUBBING = 0.1  # of the dry friction of a joint, whatever effects take away


class IndependentState(NamedTuple):
    """All that changes; rows are joints."""

    q: np.ndarray  # (j,) rad, m
    v: np.ndarray  # (j,) rad/s, m/s
    spool: np.ndarray  # (j, 2) strokes, strokes/s
    bristle: np.ndarray  # (j,) rad, m
    pressure: np.ndarray  # (j, 2) Pa
    supply: np.ndarray  # (2,) Pa, m3/s that the pump delivers
    clock: np.ndarray  # (1,) s since the machine was started
    push: np.ndarray  # (j,) N m, N that moved the joints in the last step


@njit(cache=True, error_model="numpy")
def run_independent(
    parts: IndependentParts,
    hidden: IndependentEffects,
    state: IndependentState,
    inverse: np.ndarray,
    bias: np.ndarray,
    command: np.ndarray,
    step: float,
    count: int,
) -> None:
    """Run `count` steps of `step` [s]; `inverse` (j, j) inertia, `bias` (j,) [N m, N]."""
    parts, hidden, state = borrowed(parts), borrowed(hidden), borrowed(state)
    joints = len(state.q)
    for _ in range(count):
        drawn = 0.0
        for i in range(joints):
            _shift(parts, state, i, command[i], step)
            constants = parts.constants[parts.begin[i] : parts.end[i]]
            length, lever, _slope = motion(parts.kind[i], constants, state.q[i])
            drawn += _fill(parts, state, i, length, lever * state.v[i], step)
            _press(parts, hidden, state, i, length, lever, bias[i], step)
        for i in range(joints):
            rate = 0.0
            for j in range(joints):
                rate += inverse[i, j] * (state.push[j] - bias[j])
            state.v[i] += step * rate
        for i in range(joints):
            state.q[i] += step * state.v[i]
        _pump(parts, state, drawn, step)
        state.clock[0] += step


@njit(cache=True, error_model="numpy", forceinline=True)
def _shift(
    parts: IndependentParts, state: IndependentState, i: int, command: float, step: float
) -> None:
    """The spool of joint i: second order, limited in rate and stroke."""
    omega, damping, fastest = parts.spool[i, 0], parts.spool[i, 1], parts.spool[i, 2]
    spool = state.spool[i]
    target = parts.sense[i] * min(max(command, -1.0), 1.0)
    spool[1] += step * omega * (omega * (target - spool[0]) - 2.0 * damping * spool[1])
    spool[1] = min(max(spool[1], -fastest), fastest)
    spool[0] = min(max(spool[0] + step * spool[1], -1.0), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill(
    parts: IndependentParts,
    state: IndependentState,
    i: int,
    length: float,
    rate: float,
    step: float,
) -> float:
    """Chamber pressures of joint i, whose piston moves at `rate`; what it drew from the supply."""
    spool, pressure, supply = state.spool[i, 0], state.pressure[i], state.supply[0]
    gain, overlap = parts.gain[i], parts.overlap[i]
    past = parts.leakage[i] * (pressure[1] - pressure[0])  # into A
    strokes = length - parts.stroke[i, 0], parts.stroke[i, 1] - length
    drawn = 0.0
    for side in range(2):
        way, p = (1.0 - 2.0 * side), pressure[side]
        source, source_slope = orifice(
            gain[2 * side], edge(way * spool, overlap[2 * side]), supply - p
        )
        drain, drain_slope = orifice(
            gain[2 * side + 1], edge(-way * spool, overlap[2 * side + 1]), p - parts.tank
        )
        made, made_slope = orifice(MAKE_UP, 1.0, max(parts.tank - p, 0.0))
        if p >= parts.tank:
            made_slope = 0.0
        # an endless stroke, of a motor, fills nothing
        swept = parts.filled[i, side] * strokes[side] if parts.filled[i, side] > 0.0 else 0.0
        softness = modulus(p, parts.oil[0], parts.oil[1], parts.oil[2])
        softness /= parts.dead[i, side] + max(swept, 0.0)
        flow = source - drain + made + way * past - way * parts.areas[i, side] * rate
        slope = softness * (source_slope + drain_slope + made_slope + parts.leakage[i])
        pressure[side] = relaxed(p, softness * flow, slope, step)
        drawn += source
    return drawn


@njit(cache=True, error_model="numpy", forceinline=True)
def _press(
    parts: IndependentParts, hidden: IndependentEffects, state: IndependentState, i: int,
    length: float, lever: float, bias: float, step: float,
) -> None:  # fmt: skip
    """Force that moves joint i besides the bias, and the part of each injected effect in it."""
    q, v, pressure = state.q[i], state.v[i], state.pressure[i]
    piston = parts.areas[i, 0] * pressure[0] - parts.areas[i, 1] * pressure[1]
    load = lever * piston
    depth = min(length - parts.stroke[i, 0], 0.0) + max(length - parts.stroke[i, 1], 0.0)
    if depth != 0.0:
        stop = parts.stop[i, 0] * depth + parts.stop[i, 1] * lever * v
        piston -= stop if stop * depth > 0.0 else 0.0  # it does not hold the piston back
    # bristles still carry the one direction's friction when a joint has just turned to the other
    bend = state.bristle[i]
    dry = parts.dry[i, 0 if bend > 0.0 or (bend == 0.0 and v > 0.0) else 1]
    rubbed, pushed = 0.0, 0.0
    for k in range(len(hidden.law)):
        if hidden.joint[k] != i:
            continue
        place = (q - hidden.middle[k]) / hidden.half[k]
        if hidden.law[k] < PUSHING:
            at = Rubbed(
                place, q, v, load, bias, lever,
                pressure[0], pressure[1], parts.areas[i, 0], parts.areas[i, 1],
            )  # fmt: skip
            hidden.part[k, i] = rubbing(
                hidden.law[k], hidden.value[k], hidden.memory[k], hidden.lever[k], at, step
            )
            rubbed += hidden.part[k, i]
        else:
            force = pushing(
                hidden.law[k], hidden.value[k], hidden.memory[k], place, hidden.half[k], q, v,
                state.clock[0], step,
            )  # fmt: skip
            pushed += force
            hidden.part[k, i] = beyond_dry(hidden.law[k], hidden.value[k], force, v)
    most = max(dry + rubbed, LEAST_RUBBING * dry)
    stiffness = parts.dry[i].mean() / parts.give[i]
    largest = most / stiffness
    bend = min(max(bend, -largest), largest)  # what can no longer be carried slips, undamped
    state.bristle[i] = bent(bend, v, largest, step)
    bristles = stiffness * state.bristle[i]
    damped = stiffness * BRISTLE_DAMPING * (state.bristle[i] - bend) / step
    for k in range(len(hidden.law)):
        if hidden.joint[k] == i and hidden.law[k] < PUSHING:
            hidden.part[k, i] *= bristles / most
    state.push[i] = (
        lever * piston - bristles - damped - parts.wet[i, 0 if v > 0.0 else 1] * v - pushed
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _pump(parts: IndependentParts, state: IndependentState, drawn: float, step: float) -> None:
    """Supply pressure, from what the pump delivers, late, and what the valves drew."""
    line = parts.supply
    share = min(max((line.set_pressure - state.supply[0]) / line.droop, 0.0), 1.0)
    state.supply[1] -= math.expm1(-step / line.lag) * (line.most * share - state.supply[1])
    spilt = line.spill * max(state.supply[0] - line.relief, 0.0)
    stiff = modulus(state.supply[0], parts.oil[0], parts.oil[1], parts.oil[2])
    state.supply[0] += step * stiff / line.volume * (state.supply[1] - drawn - spilt)
