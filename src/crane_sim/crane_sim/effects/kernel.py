"""All forms of injected effects, and their part in a step of the plant.

`act` comes before the velocities are found, `settle` after. Nothing here runs, or is compiled, for
a plant without injected effects.
"""

from itertools import groupby

import numpy as np
from numba import njit

from crane_sim.effects import flow, forces, friction, loads, sensing
from crane_sim.effects.form import FLOW, FRICTION, LOADS, MEMORY, PUSHES, Form, Injected
from crane_sim.parts.constants import Constants, Scratch, State

_ALL = (
    *friction.FRICTION_FORMS,
    *forces.PUSH_FORMS,
    *forces.MEMORY_FORMS,
    *loads.BENDING_FORMS,
    *loads.LOAD_FORMS,
    *sensing.SENSING_FORMS,
    *flow.FLOW_FORMS,
)

FORMS: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms) for effect, forms in groupby(_ALL, key=lambda form: form.effect)
}
"""Effect to its forms, the first of which is the default."""


@njit(cache=True, error_model="numpy", forceinline=True)
def act(
    injected: Injected, constants: Constants, state: State, scratch: Scratch, step: float
) -> None:
    """Add to mass, bias, forces and friction of `scratch`; its friction is that of the machine."""
    for i in range(len(state.q)):
        scratch.law[i] = constants.friction[i]
    count = len(injected.law)
    for k in range(count):
        if LOADS <= injected.law[k] < FLOW:
            if injected.law[k] >= loads.TWO_MODES:
                loads.carry_bent(injected, k, constants.chain, state.q, state.v, scratch)
            else:
                loads.carry(injected, k, constants.chain, state)
    for k in range(count):  # each was asked beside the machine alone
        if LOADS <= injected.law[k] < FLOW and injected.law[k] not in loads.SLEWS:
            for i in range(len(state.q)):
                scratch.bias[i] += injected.bias[k, i]
                for j in range(len(state.q)):
                    scratch.mass[i, j] += injected.mass[k, i, j]
    for k in range(count):  # friction follows the forces of the cylinders, so it comes first
        if FRICTION <= injected.law[k] < PUSHES:
            injected.part[k] = _raise(injected, k, constants, state, scratch, step)
    for k in range(count):
        if PUSHES <= injected.law[k] < LOADS:
            injected.part[k] = _resist(injected, k, state, scratch, step)


@njit(cache=True, error_model="numpy", forceinline=True)
def _raise(
    injected: Injected, k: int, constants: Constants, state: State, scratch: Scratch, step: float
) -> float:
    """Coulomb friction of effect k [N m, N]; what is left of that of the joint stays above 0."""
    i = injected.joint[k]
    law = scratch.law[i]
    extra = friction.level(injected, k, i, constants, state, scratch, step)
    extra = max(extra, -0.95 * min(law.coulomb_up, law.coulomb_down))
    law.coulomb_up += extra
    law.coulomb_down += extra
    return extra


@njit(cache=True, error_model="numpy", forceinline=True)
def _resist(injected: Injected, k: int, state: State, scratch: Scratch, step: float) -> float:
    """Let effect k resist; what of it deviates from the model of (13) [N m, N]."""
    i, law = injected.joint[k], injected.law[k]
    v = scratch.before[i]
    if law < MEMORY:
        force = forces.push(injected, k, i, state)
    elif law >= forces.RELAXING:
        force = forces.hose(injected, k, v, step)
    elif law >= forces.PIN_PLAY:
        force = forces.play(injected, k, scratch.force[i], state.q[i])
    else:
        up, down = forces.replaced(injected.value[k], scratch, i)
        share = forces.presliding(injected, k, v, step)
        force = share * (up if share >= 0.0 else down)
        scratch.force[i] -= force
        sliding = up if v > 0.0 else -down
        return force - sliding if abs(v) > forces.SLIDING_SPEED else 0.0
    scratch.force[i] -= force
    return force


@njit(cache=True, error_model="numpy", forceinline=True)
def settle(
    injected: Injected, constants: Constants, state: State, scratch: Scratch, step: float
) -> None:
    """Note what each effect asked of the drives in this step, and advance what follows from it."""
    change = scratch.impulse  # it has done its work in this step
    for i in range(len(state.q)):
        change[i] = state.v[i] - scratch.before[i]
    for k in range(len(injected.law)):
        i, law = injected.joint[k], injected.law[k]
        if law < PUSHES:
            injected.force[k, i] = injected.part[k] * np.sign(state.v[i])
        elif law < LOADS:
            injected.force[k, i] = injected.part[k]
        elif law < FLOW:
            for a in range(len(state.q)):
                total = injected.bias[k, a]
                for b in range(len(state.q)):
                    total += injected.mass[k, a, b] * change[b] / step
                injected.force[k, a] = total
            if law in (loads.PENDULUM, loads.IN_AIR, loads.RUBBING_HOOK):
                loads.swing(injected, k, constants.chain, state.q, change, step)
            elif law >= loads.TWO_MODES:
                loads.bend(injected, k, change, step)
    injected.clock[0] += step
