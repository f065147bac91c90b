"""Oil: servo valves, orifices, chambers, pump and relief valve, as compiled scalar functions.

Pressures are gauge [Pa], flows [m3/s]. Spool opening x in -1..1: positive opens supply to chamber
A and chamber B to tank.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

EDGES = ("supply_a", "a_tank", "supply_b", "b_tank")
"""The metering edges of a valve, by what they join."""
VALVE = ("sense", "frequency", "damping_ratio", "rate_limit", "dead_zone", "null", *EDGES)
"""Fields of a valve's record. `sense` is +1 where extending the cylinder moves the joint in its
positive direction, else -1; frequency [rad/s] of the undamped spool; rate_limit [strokes/s];
dead_zone [strokes] to either side of `null` [strokes]; of each edge the gain, fully open
[m3/s/sqrt(Pa)]."""


class Oil(NamedTuple):
    """The oil, and the supply line that all valves share."""

    bulk_modulus: float  # Pa
    laminar_drop: float  # Pa, below it an orifice turns from turbulent to laminar
    check_valve_gain: float  # m3/s/sqrt(Pa), make-up flow from tank into a chamber below tank
    supply_volume: float  # m3
    pump_flow: float  # m3/s, most that the pump delivers
    set_pressure: float  # Pa, where the pump's delivery is controlled to zero
    droop: float  # Pa below it, where the pump delivers all it can
    relief_pressure: float  # Pa, where the relief valve opens
    relief_gain: float  # m3/s/Pa
    tank_pressure: float  # Pa


@njit(cache=True, error_model="numpy")
def spool_step(
    valve: np.record,
    free: tuple[float, float, float, float],
    command: float,
    position: float,
    rate: float,
    step: float,
) -> tuple[float, float]:
    """Spool position and rate after one step: second order, limited in rate and stroke.

    `free` is its exact `transition` in that time where no limit holds it back.
    """
    target = valve.sense * min(max(command, -1.0), 1.0)
    off = position - target
    moved = target + free[0] * off + free[1] * rate - position
    limit = valve.rate_limit
    position += min(max(moved, -step * limit), step * limit)
    rate = min(max(free[2] * off + free[3] * rate, -limit), limit)
    if abs(position) >= 1.0:  # the spool lies against its stop
        return math.copysign(1.0, position), 0.0
    return position, rate


@njit(cache=True, error_model="numpy")
def opening(position: float, dead_zone: float) -> float:
    """Metering opening in -1..1 of a spool with overlap: zero inside the dead zone."""
    if abs(position) <= dead_zone:
        return 0.0
    return (position - math.copysign(dead_zone, position)) / (1.0 - dead_zone)


@njit(cache=True, error_model="numpy")
def conductances(valve: np.record, x: float) -> tuple[float, float]:
    """What chambers A and B see at a metering opening x [m3/s/sqrt(Pa)]: see `port_flow`."""
    if x > 0.0:
        return valve.supply_a * x, -valve.b_tank * x
    return valve.a_tank * x, -valve.supply_b * x


@njit(cache=True, error_model="numpy")
def signed_root(drop: float, laminar: float) -> tuple[float, float]:
    """Turbulent orifice: sgn(d) sqrt|d|, made linear for |d| below `laminar`; and its slope.

    d / (d^2 + laminar^2)^(1/4): odd, increasing, with slope at most 1/sqrt(laminar).
    """
    square = drop * drop + laminar * laminar
    rooted = math.sqrt(square)
    fourth = math.sqrt(rooted)
    return drop / fourth, (0.5 * drop * drop + laminar * laminar) / (square * fourth)


@njit(cache=True, error_model="numpy")
def port_flow(oil: Oil, conductance: float, p_supply: float, p: float) -> tuple[float, float]:
    """Flow into a chamber through its metering edge, and its derivative to the chamber pressure.

    `conductance` [m3/s/sqrt(Pa)] is gain times opening: positive to supply, negative to tank.
    """
    source = p_supply if conductance > 0.0 else oil.tank_pressure
    root, slope = signed_root(source - p, oil.laminar_drop)
    return abs(conductance) * root, -abs(conductance) * slope


@njit(cache=True, error_model="numpy")
def chamber_step(
    oil: Oil,
    p: float,
    p_other: float,
    flow: float,
    slope: float,
    leakage: float,
    volume: float,
    growth: float,
    step: float,
) -> tuple[float, float]:
    """Chamber pressure after one step, and the valve flow that went in meanwhile.

    p' = beta / V (Q - V' - leakage (p - p_other)): what flows in fills the volume, is compressed
    or leaks. `growth` is V'. Linearly implicit in p, so that a small chamber behind a wide
    orifice stays stable.
    """
    if p < oil.tank_pressure:
        root, check_slope = signed_root(oil.tank_pressure - p, oil.laminar_drop)
        flow += oil.check_valve_gain * root
        slope -= oil.check_valve_gain * check_slope
    elasticity = step * oil.bulk_modulus / volume
    change = elasticity * (flow - growth - leakage * (p - p_other))
    change /= 1.0 - elasticity * (slope - leakage)
    return p + change, flow + slope * change


@njit(cache=True, error_model="numpy")
def pump_flow(oil: Oil, p_supply: float) -> float:
    """Delivery of the pressure-controlled pump, from none to all it can."""
    return oil.pump_flow * min(max((oil.set_pressure - p_supply) / oil.droop, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def relief_flow(oil: Oil, p_supply: float) -> float:
    """Flow that the relief valve returns to tank."""
    return oil.relief_gain * max(p_supply - oil.relief_pressure, 0.0)
