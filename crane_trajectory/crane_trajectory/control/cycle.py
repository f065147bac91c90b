"""A cycle of the model-based controllers in compiled code: see `flow_feedforward`."""

import math

import numpy as np
from numba import njit

from crane_trajectory.control.adaptation import adapt, at_bound
from crane_trajectory.control.geometry import length_and_lever
from crane_trajectory.control.interface import Condition
from crane_trajectory.control.inverse_flow import (
    against_play,
    speed_at_pressures,
    speed_under_load,
    spool,
    stiffness,
)
from crane_trajectory.control.watch import NO_NEWS, answer, transducers_good

DAMPED = 0.2  # s: slower pressure changes are the load's, faster ones the oil's swinging
BUMP = 0.2  # s, in which what a transition would make jump decays
STOP_RATE = 5.0  # 1/s, at which the command of a controller that stops goes to zero
LARGEST_INTEGRAL = 0.2  # of the largest speed: what the integral may ask for
RESTING = 1e-6  # rad/s, rad/s2 or m: a reference that is slower rests
FORCE_GAIN = 20.0  # 1/s, of computed force: of the measured force towards the wanted one
FORCE_PER_SPEED = 0.02  # s: force that an error of the piston's speed asks for, over k_A + k_B
HISTORY = 64  # cycles of load and spool that are remembered

STATE = (
    "integral", "load", "slow", "bump", "opening", "turned", "direction", "command", "begun",
    "pressed", "resting", "condition", "squeezed", "length",
)  # fmt: skip
"""Fields of what a joint remembers: integral [rad/s, m/s]; force ahead [N]; slow part of what the
measured force has more [N]; opening to decay, and last; where the play was last taken up, and in
which direction; command; whether the first cycle is over, the pressures are used, the joint rests;
`Condition`; how far the oil is squeezed beyond what the load does, and where the piston stood, less
that [m]."""

FOLLOWING, AT_REST = int(Condition.FOLLOWING), int(Condition.AT_REST)
AT_BOUND, LOST = int(Condition.ADAPTATION_AT_BOUND), int(Condition.PRESSURES_LOST)
SATURATED, UNMEASURED = int(Condition.SATURATED), int(Condition.NOT_MEASURED)
STOPS = int(Condition.NOT_INITIALISED)


@njit(cache=True, error_model="numpy")
def cycle(setting, begun, dt, count, reading, wanted, load, memory, u):
    """Commands u (j,) of all joints.

    `setting` is hydraulics, gains, tables, fitted, adaptive, by_force, preview; `reading` q, v,
    p_a, p_b, supply; `wanted` q now, then q, v, a ahead; `load` (j,) the generalized forces ahead;
    `memory` state, watch, learnt, windows, forces, spools: all as `FlowFeedforward` has them.
    """
    state = memory[0]
    stop = not begun
    for i in range(len(u)):
        known = reading[0][i] + load[i]
        for each in wanted:
            known += each[i]
        if not math.isfinite(known) and state[i].condition < STOPS:
            state[i].condition = UNMEASURED
        stop |= state[i].condition >= STOPS
    for i in range(len(u)):
        if stop:
            _close(state[i], dt)
        else:
            _joint(i, setting, dt, count, reading, wanted, load[i], memory)
        u[i] = state[i].command


@njit(cache=True, error_model="numpy")
def _close(s, dt):
    """Lead the command towards zero."""
    s.command = math.copysign(max(abs(s.command) - STOP_RATE * dt, 0.0), s.command)
    s.opening = s.integral = s.bump = 0.0


@njit(cache=True, error_model="numpy")
def _opened(y, learnt):
    """The opening of a spool y."""
    side = 0 if y > 0.0 else 1
    return math.copysign(max(abs(y) - learnt[side, 0], 0.0) / learnt[side, 1], y)


@njit(cache=True, error_model="numpy")
def _before(history, count, cycles):
    """What was noted `cycles` ago (whole ones and a share) at the one with the number `count`."""
    cycles = min(cycles, min(count, HISTORY - 2))
    whole = int(cycles)
    newer = history[(count - whole) % HISTORY]
    older = history[(count - min(whole + 1, count)) % HISTORY]
    return newer + (cycles - whole) * (older - newer)


@njit(cache=True, error_model="numpy")
def _joint(i, setting, dt, count, reading, wanted, tau, memory):
    """A cycle of one joint; its command is left in its state."""
    hydraulics, gains, tables, fitted, adaptive, by_force, preview = setting
    h, gain, table, joint_fitted = hydraulics[i], gains[i], tables[i], fitted[i]
    q, v, p_a, p_b = reading[0][i], reading[1][i], reading[2][i], reading[3][i]
    q_now, q_ahead, v_ahead, a_ahead = wanted[0][i], wanted[1][i], wanted[2][i], wanted[3][i]
    state, watch, learnt, windows, forces, spools = memory
    s = state[i]
    supply = reading[4]
    if not supply > 0.5 * h.supply_pressure:  # or not measured
        supply = h.supply_pressure

    length, lever = length_and_lever(table, q_ahead)
    k_a, k_b = stiffness(h, length)
    stiff = k_a + k_b
    force = tau / lever
    if s.begun == 0.0:
        s.load = force
        forces[i, :] = force
    rate = (force - s.load) / dt if dt > 0.0 else 0.0
    s.load = forces[i, count % HISTORY] = force
    lagging = max(h.lag / dt, 1.0) if dt > 0.0 else 1.0
    force_now, spool_now = _before(forces[i], count, lagging), _before(spools[i], count, lagging)
    moves = abs(v_ahead) > RESTING or abs(a_ahead) > RESTING
    used = joint_fitted and transducers_good(
        watch[i], h.area_a, h.area_b, h.supply_pressure, p_a, p_b, force_now, moves, dt
    )

    here, lever_here = length_and_lever(table, q)
    opened, extends = _opened(spool_now, learnt[i]), spool_now > 0.0
    if used:
        yields = speed_at_pressures(h, extends, p_a, p_b, supply, k_a, k_b)
    else:
        yields = speed_under_load(h, extends, force_now, supply)
    put, s.length = s.length, here + force_now / stiff
    if s.begun > 0.0:
        s.squeezed += opened * yields * dt - (s.length - put)
    s.squeezed *= math.exp(-dt / DAMPED)

    error = q_now - q
    speed_wanted = v_ahead + a_ahead * (h.lag - preview) + s.integral
    n = lever * (speed_wanted + gain.kv * error) + rate / stiff
    if used:
        measured = h.area_a * p_a - h.area_b * p_b
        misfit = measured - force_now
        if s.pressed == 0.0:
            s.slow = misfit
        s.slow += (misfit - s.slow) * min(dt / DAMPED, 1.0)
        if by_force and math.isfinite(v):
            asked = force + FORCE_PER_SPEED * stiff * lever * (speed_wanted + gain.kv * error - v)
            n = lever * v + (rate + FORCE_GAIN * (asked - measured)) / stiff
        else:
            n -= gain.kp * (misfit - s.slow) / stiff
        n += h.leakage * (p_a - p_b) * (k_a / h.area_a + k_b / h.area_b) / stiff
        speed = speed_at_pressures(h, n > 0.0, p_a, p_b, supply, k_a, k_b)
    else:
        n -= gain.kp_alone * s.squeezed
        speed = speed_under_load(h, n > 0.0, force, supply)
    opening = n / speed
    if s.begun == 0.0:
        y = h.sense * s.command
        s.opening = _opened(y, learnt[i])
    if s.begun == 0.0 or used != (s.pressed > 0.0):
        s.bump = s.opening - opening
    else:
        s.bump *= math.exp(-dt / BUMP)
    opening += s.bump
    s.begun, s.pressed = 1.0, 1.0 if used else 0.0

    if adaptive and used:
        adapt(learnt[i], windows[i], spool_now, yields, here + measured / stiff, dt)
    side = 0 if opening > 0.0 else 1
    dead_zone, travel = learnt[i, side, 0], learnt[i, side, 1]
    news = answer(watch[i], opened, opened * yields / lever_here, v, dt)
    if news != NO_NEWS:
        s.condition = news
        _close(s, dt)
        return

    near = gain.tolerance * (2.0 if s.resting > 0.0 else 1.0)
    if not moves and abs(error) <= near:
        s.resting, s.condition = 1.0, AT_REST
        _close(s, dt)
        spools[i, count % HISTORY] = 0.0
        return
    s.resting, s.opening = 0.0, opening
    y = spool(opening, dead_zone, travel)
    spools[i, count % HISTORY] = min(max(y, -1.0), 1.0)
    if h.play > 0.0:
        y, s.turned, s.direction = against_play(y, s.turned, s.direction, h.play)
    saturated = abs(y) >= 1.0
    s.command = h.sense * min(max(y, -1.0), 1.0)
    if not saturated:
        most = LARGEST_INTEGRAL * gain.largest_speed
        s.integral = min(max(s.integral + gain.ki * error * dt, -most), most)
    s.condition = FOLLOWING
    if adaptive and at_bound(learnt[i]):
        s.condition = AT_BOUND
    if joint_fitted and not used:
        s.condition = LOST
    if saturated:
        s.condition = SATURATED
