"""What a cycle knows of a cylinder, and what the oil in it asks for: see `flow_feedforward`."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_trajectory.control.adaptation import adapt
from crane_trajectory.control.geometry import length_and_lever
from crane_trajectory.control.inverse_flow import edges, flow_at_pressures, speed_under_load
from crane_trajectory.control.memory import CycleSetting, Memory

DAMPED = 0.2  # s: slower pressure changes are the load's, faster ones the oil's swinging
FORCE_GAIN = 20.0  # 1/s, of computed force: of the measured force towards the wanted one
FORCE_PER_SPEED = 0.02  # s: force that an error of the piston's speed asks for, over k_A + k_B


class Piston(NamedTuple):
    """What a cycle knows of a cylinder."""

    force: float  # N, of the model, as it ought to be now
    spool: float  # that is in force now, as far as the lag of loop and valve is known
    supply: float  # Pa
    stiffness_a: float  # N/m, k_A
    stiffness_b: float
    used: bool  # whether the pressures are


@njit(cache=True, error_model="numpy")
def opened(y: float, learnt: np.ndarray) -> float:
    """How far a spool y is beyond its dead zone."""
    side = 0 if y > 0.0 else 1
    return math.copysign(max(abs(y) - learnt[side, 0, 0], 0.0), y)


@njit(cache=True, error_model="numpy")
def speed_opened(
    h: np.record,
    learnt: np.ndarray,
    extends: bool,
    piston: Piston,
    force: float,
    p_a: float,
    p_b: float,
) -> float:
    """g [m/s], the speed of the piston at an opening of 1, with what was learnt."""
    known = learnt[0 if extends else 1, 0]
    gain_a, gain_b = edges(h, extends)
    gain_a, gain_b = gain_a / known[1], gain_b / known[2]
    if not piston.used:
        return speed_under_load(h, extends, gain_a, gain_b, force, piston.supply)
    flow_a, flow_b = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
    by_a = piston.stiffness_a * flow_a / h.area_a
    by_b = piston.stiffness_b * flow_b / h.area_b
    return (by_a + by_b) / (piston.stiffness_a + piston.stiffness_b)


@njit(cache=True, error_model="numpy")
def look_back(
    i: int,
    setting: CycleSetting,
    memory: Memory,
    piston: Piston,
    q: float,
    p_a: float,
    p_b: float,
    dt: float,
) -> float:
    """Take in what the crane made of the spool that is in force: the joint's speed that it ought
    to have. Learns from what it has, and keeps what the oil seems to be squeezed by.
    """
    h, s, learnt, y = setting.hydraulics[i], memory.state[i], memory.learnt[i], piston.spool
    here, lever = length_and_lever(setting.tables[i], q)
    extends = y > 0.0
    way = here - s.stood if s.begun > 0.0 else 0.0
    piston_speed = opened(y, learnt) * speed_opened(
        h, learnt, extends, piston, piston.force, p_a, p_b
    )
    if setting.adaptive and piston.used:
        gain_a, gain_b = edges(h, extends)
        flow_a, flow_b = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
        leaked, forth = h.leakage * (p_a - p_b) * dt, 1.0 if extends else -1.0
        oil_a = h.area_a * (way + h.area_a * (p_a - s.p_a) / piston.stiffness_a) + leaked
        oil_b = h.area_b * (way - h.area_b * (p_b - s.p_b) / piston.stiffness_b) + leaked
        adapt(learnt, memory.windows[i], y, flow_a, flow_b, forth * oil_a, forth * oil_b, dt)
    s.p_a, s.p_b = (p_a, p_b) if piston.used else (math.nan, math.nan)
    s.stood = here
    s.squeezed = (s.squeezed + piston_speed * dt - way) * math.exp(-dt / DAMPED)
    return piston_speed / lever


@njit(cache=True, error_model="numpy")
def damping(
    setting: CycleSetting,
    gain: np.record,
    h: np.record,
    s: np.record,
    piston: Piston,
    force: float,
    lever: float,
    speed: float,
    velocity: float,
    p_a: float,
    p_b: float,
    dt: float,
) -> float:
    """What n has more than reference, error and load ask for [m/s]: damping, leakage."""
    k_a, k_b = piston.stiffness_a, piston.stiffness_b
    if not piston.used:
        return -gain.kp_alone * s.squeezed
    misfit = h.area_a * p_a - h.area_b * p_b - piston.force
    if s.pressed == 0.0:
        s.slow = misfit
    s.slow += (misfit - s.slow) * min(dt / DAMPED, 1.0)
    leaked = h.leakage * (p_a - p_b) * (k_a / h.area_a + k_b / h.area_b) / (k_a + k_b)
    if setting.by_force and math.isfinite(velocity):
        late = lever * (speed - velocity)
        lacking = (force - piston.force - misfit) / (k_a + k_b) + FORCE_PER_SPEED * late
        return FORCE_GAIN * lacking - late + leaked
    return leaked - gain.kp * (misfit - s.slow) / (k_a + k_b)
