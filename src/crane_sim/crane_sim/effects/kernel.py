"""Hidden effects in a step of the plant: `act` before the velocities are found, `settle` after.

Nothing here runs, or is compiled, for a plant that hides nothing.
"""

import numpy as np
from numba import njit

from crane_sim.effects import bending, friction, loads, memory, pushes
from crane_sim.effects.working import FLOW, FRICTION, LOADS, MEMORY, PUSHES, Hidden
from crane_sim.parts.constants import Constants, Scratch, State


@njit(cache=True, error_model="numpy", forceinline=True)
def act(hidden: Hidden, constants: Constants, state: State, scratch: Scratch, step: float) -> None:
    """Add to mass, bias, forces and friction of `scratch`; its friction is that of the machine."""
    for i in range(len(state.q)):
        scratch.law[i] = constants.friction[i]
    count = len(hidden.law)
    for k in range(count):
        if LOADS <= hidden.law[k] < FLOW:
            if hidden.law[k] >= bending.TWO_MODES:
                bending.carry(hidden, k, constants.chain, state.q, state.v, scratch)
            else:
                loads.carry(hidden, k, constants.chain, state)
    for k in range(count):  # each was asked beside the machine alone
        if LOADS <= hidden.law[k] < FLOW and hidden.law[k] not in loads.SLEWS:
            for i in range(len(state.q)):
                scratch.bias[i] += hidden.bias[k, i]
                for j in range(len(state.q)):
                    scratch.mass[i, j] += hidden.mass[k, i, j]
    for k in range(count):  # friction follows the forces of the cylinders, so it comes first
        if FRICTION <= hidden.law[k] < PUSHES:
            hidden.part[k] = _raise(hidden, k, constants, state, scratch, step)
    for k in range(count):
        if PUSHES <= hidden.law[k] < LOADS:
            hidden.part[k] = _resist(hidden, k, state, scratch, step)


@njit(cache=True, error_model="numpy", forceinline=True)
def _raise(
    hidden: Hidden, k: int, constants: Constants, state: State, scratch: Scratch, step: float
) -> float:
    """Coulomb friction of effect k [N m, N]; what is left of that of the joint stays above 0."""
    i = hidden.joint[k]
    law = scratch.law[i]
    extra = friction.level(hidden, k, i, constants, state, scratch, step)
    extra = max(extra, -0.95 * min(law.coulomb_up, law.coulomb_down))
    law.coulomb_up += extra
    law.coulomb_down += extra
    return extra


@njit(cache=True, error_model="numpy", forceinline=True)
def _resist(hidden: Hidden, k: int, state: State, scratch: Scratch, step: float) -> float:
    """Let effect k resist; what of it deviates from the model of (13) [N m, N]."""
    i, law = hidden.joint[k], hidden.law[k]
    v = scratch.before[i]
    if law < MEMORY:
        force = pushes.push(hidden, k, i, state)
    elif law >= memory.RELAXING:
        force = memory.hose(hidden, k, v, step)
    elif law >= memory.PIN_PLAY:
        force = memory.play(hidden, k, scratch.force[i], state.q[i])
    else:
        up, down = memory.replaced(hidden.value[k], scratch, i)
        share = memory.presliding(hidden, k, v, step)
        force = share * (up if share >= 0.0 else down)
        scratch.force[i] -= force
        sliding = up if v > 0.0 else -down
        return force - sliding if abs(v) > memory.STILL else 0.0
    scratch.force[i] -= force
    return force


@njit(cache=True, error_model="numpy", forceinline=True)
def settle(
    hidden: Hidden, constants: Constants, state: State, scratch: Scratch, step: float
) -> None:
    """Note what each effect asked of the drives in this step, and advance what follows from it."""
    change = scratch.impulse  # it has done its work in this step
    for i in range(len(state.q)):
        change[i] = state.v[i] - scratch.before[i]
    for k in range(len(hidden.law)):
        i, law = hidden.joint[k], hidden.law[k]
        if law < PUSHES:
            hidden.force[k, i] = hidden.part[k] * np.sign(state.v[i])
        elif law < LOADS:
            hidden.force[k, i] = hidden.part[k]
        elif law < FLOW:
            for a in range(len(state.q)):
                total = hidden.bias[k, a]
                for b in range(len(state.q)):
                    total += hidden.mass[k, a, b] * change[b] / step
                hidden.force[k, a] = total
            if law in (loads.PENDULUM, loads.IN_AIR, loads.RUBBING_HOOK):
                loads.swing(hidden, k, constants.chain, state.q, change, step)
            elif law >= bending.TWO_MODES:
                bending.bend(hidden, k, change, step)
    hidden.clock[0] += step
