"""A step of the plant: valves, bodies and friction, oil, one after the other in compiled code."""

import numpy as np
from numba import njit

from crane_model.hydraulics.spool import transition
from crane_sim.effects.flow import leak, meter, note_softness, softness
from crane_sim.effects.kernel import act, settle
from crane_sim.effects.working import Hidden
from crane_sim.parts.borrowed import borrowed
from crane_sim.parts.constants import Constants
from crane_sim.parts.cylinders import set_lengths_and_levers, stop_force
from crane_sim.parts.friction import step_lugre, step_set_valued
from crane_sim.parts.hydraulics import (
    chamber_step,
    conductances,
    opening,
    port_flow,
    pump_flow,
    relief_flow,
    spool_step,
)
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_sim.parts.state import Scratch, State


@njit(cache=True, error_model="numpy", forceinline=True)
def _generalized_forces(constants: Constants, state: State, force: np.ndarray) -> None:
    """What drives the joints, friction and inertia apart: (j,) N m, N.

    What hidden effects add to it, and to the bodies and the friction, is in `hidden.kernel`.
    """
    for i in range(len(state.q)):
        cylinder, actuator = constants.cylinders[i], state.actuators[i]
        piston = cylinder.area_a * actuator.p_a - cylinder.area_b * actuator.p_b  # (19)
        piston += stop_force(cylinder, actuator.length, actuator.lever * state.v[i])
        force[i] = actuator.lever * piston  # (18)


@njit(cache=True, error_model="numpy", forceinline=True)
def _move(
    constants: Constants, hidden: Hidden | None, state: State, scratch: Scratch, step: float
) -> None:
    """Velocities from the forces (6), then positions and cylinders from the new velocities."""
    mass_and_bias(constants.chain, state.q, state.v, scratch.mass, scratch.bias)
    _generalized_forces(constants, state, scratch.force)
    law = constants.friction
    for i in range(len(state.q)):
        scratch.before[i] = state.v[i]
    if hidden is not None:
        act(hidden, constants, state, scratch, step)
        law = scratch.law
    for i in range(len(state.q)):
        impulse = step * (scratch.force[i] - scratch.bias[i])
        for j in range(len(state.q)):
            impulse += scratch.mass[i, j] * state.v[j]
        scratch.impulse[i] = impulse
    if constants.dynamic_friction:
        step_lugre(
            law, scratch.mass, scratch.impulse, step,
            state.bristle, scratch.friction, state.v,
        )  # fmt: skip
    else:
        step_set_valued(
            law, scratch.mass, scratch.impulse, step,
            state.mode, scratch.friction, state.v,
        )  # fmt: skip
    if hidden is not None:
        settle(hidden, constants, state, scratch, step)
    for i in range(len(state.q)):
        state.q[i] += step * state.v[i]
        scratch.growth[i] = -state.actuators[i].length
    set_lengths_and_levers(constants.linkages, state.q, state.actuators)
    # by what the length really changed, so that no oil is made or lost
    for i in range(len(state.q)):
        scratch.growth[i] = (scratch.growth[i] + state.actuators[i].length) / step


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill(
    constants: Constants, hidden: Hidden | None, state: State, growth: np.ndarray, step: float
) -> None:
    """Chamber and supply pressures from valve openings and piston speeds `growth` (j,)."""
    oil, supply = constants.oil, state.supply[0]
    drawn = 0.0
    for i in range(len(state.q)):
        cylinder, valve = constants.cylinders[i], constants.valves[i]
        actuator = state.actuators[i]
        p_a, p_b = actuator.p_a, actuator.p_b
        x = opening(actuator.spool - valve.null, valve.dead_zone)
        leakage, softer_a, softer_b = cylinder.leakage, 1.0, 1.0
        if hidden is not None:  # a call that finds nothing to do costs more than the rest
            if hidden.meters:
                x = meter(hidden, constants, state, i)
            if hidden.leaks:
                leakage = leak(hidden, constants, state, i)
            if hidden.softens:
                softer_a = softness(hidden, constants, i, p_a)
                softer_b = softness(hidden, constants, i, p_b)
        open_a, open_b = conductances(valve, x)
        volume = cylinder.dead_volume_a + cylinder.filled_a * (
            actuator.length - cylinder.length_min
        )
        flow, slope = port_flow(oil, open_a, supply, p_a)
        actuator.p_a, flow_a = chamber_step(
            oil, p_a, p_b, flow, slope, leakage, softer_a * volume,
            cylinder.area_a * growth[i], step,
        )  # fmt: skip
        if hidden is not None and hidden.softens:
            note_softness(hidden, constants, i, p_a, volume, (actuator.p_a - p_a) / step)
        volume = cylinder.dead_volume_b + cylinder.filled_b * (
            cylinder.length_max - actuator.length
        )
        flow, slope = port_flow(oil, open_b, supply, p_b)
        actuator.p_b, flow_b = chamber_step(
            oil, p_b, p_a, flow, slope, leakage, softer_b * volume,
            -cylinder.area_b * growth[i], step,
        )  # fmt: skip
        if x > 0.0:
            drawn += flow_a
        elif x < 0.0:
            drawn += flow_b
    supplied = pump_flow(oil, supply) - relief_flow(oil, supply)
    state.supply[0] += step * oil.bulk_modulus / oil.supply_volume * (supplied - drawn)


@njit(cache=True, error_model="numpy")
def advance(
    constants: Constants,
    hidden: Hidden | None,
    state: State,
    scratch: Scratch,
    command: np.ndarray,
    step: float,
    count: int,
) -> None:
    """`count` steps of `step` [s] with spool commands (j,) in -1..1.

    Oil flows through the opening that a spool has in the middle of a step, in the mean.
    """
    constants, hidden = borrowed(constants), borrowed(hidden)
    state, scratch = borrowed(state), borrowed(scratch)
    half = 0.5 * step
    free = [transition(one.frequency, one.damping_ratio, half) for one in constants.valves]
    for _ in range(count):
        _shift(constants, state, free, command, half)
        _move(constants, hidden, state, scratch, step)
        _fill(constants, hidden, state, scratch.growth, step)
        _shift(constants, state, free, command, half)


@njit(cache=True, error_model="numpy", forceinline=True)
def _shift(
    constants: Constants,
    state: State,
    free: list[tuple[float, float, float, float]],
    command: np.ndarray,
    step: float,
) -> None:
    """Spools, of which `free` is the transition in that time."""
    for i in range(len(state.q)):
        actuator = state.actuators[i]
        actuator.spool, actuator.spool_rate = spool_step(
            constants.valves[i], free[i], command[i], actuator.spool, actuator.spool_rate, step
        )
