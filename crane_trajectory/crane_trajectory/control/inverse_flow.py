"""The flow of a valve-controlled cylinder, turned round: from a wanted piston speed to a spool.

A chamber of volume V, area A takes the flow K o sqrt(drop) at an opening o. With
k = beta A^2 / V, the stiffness of its oil, the force F = A_A p_A - A_B p_B follows

    F' = k_A Q_A / A_A + k_B Q_B / A_B - (k_A + k_B) x'

so that the piston speed x' and the force rate F' need the opening o = n / g, with

    n = x' + F' / (k_A + k_B),    g = [k_A Q_A / A_A + k_B Q_B / A_B] / (k_A + k_B) at o = 1

Q_B what leaves B. Where the pressures are not measured, g follows from the load: flow through
both edges at the same piston speed.
"""

import math

import numpy as np
from numba import njit

LEAST_DROP = 2.0e5  # Pa at an edge, of that which is inverted: below it speed is not to be had
OPENING_AT_EDGE = 0.002  # the command crosses the dead zone within +- this opening


@njit(cache=True, error_model="numpy")
def stiffness(hydraulics: np.record, length: float) -> tuple[float, float]:
    """k_A, k_B [N/m] of the oil at a cylinder length [m]."""
    a, b = hydraulics.area_a, hydraulics.area_b
    low, high = hydraulics.length_min, hydraulics.length_max
    x = min(max(length, low), high)
    margin = 1e-3 * (high - low)  # a dead volume may be zero
    return (
        hydraulics.bulk_modulus * a * a / (hydraulics.dead_volume_a + a * (x - low + margin)),
        hydraulics.bulk_modulus * b * b / (hydraulics.dead_volume_b + b * (high - x + margin)),
    )


@njit(cache=True, error_model="numpy")
def edges(hydraulics: np.record, extending: bool) -> tuple[float, float]:
    """Gains of the edges at chamber A and B that are open."""
    if extending:
        return hydraulics.supply_a, hydraulics.b_tank
    return hydraulics.a_tank, hydraulics.supply_b


@njit(cache=True, error_model="numpy")
def speed_under_load(
    hydraulics: np.record, extending: bool, gain_a: float, gain_b: float, load: float, supply: float
) -> float:
    """g [m/s] from the force on the piston [N]: both edges pass what the piston sweeps."""
    a, b, tank = hydraulics.area_a, hydraulics.area_b, hydraulics.tank_pressure
    drop = a * supply - b * tank - load if extending else load + b * supply - a * tank
    resistance = a**3 / gain_a**2 + b**3 / gain_b**2
    return math.sqrt(max(drop, (a + b) * LEAST_DROP) / resistance)


@njit(cache=True, error_model="numpy")
def flow_at_pressures(
    hydraulics: np.record,
    extending: bool,
    gain_a: float,
    gain_b: float,
    pressure_a: float,
    pressure_b: float,
    supply: float,
) -> tuple[float, float]:
    """Q_A, Q_B [m3/s] at an opening of 1, positive in the direction of the motion."""
    tank = hydraulics.tank_pressure
    drop_a = supply - pressure_a if extending else pressure_a - tank
    drop_b = pressure_b - tank if extending else supply - pressure_b
    return (
        gain_a * math.sqrt(max(drop_a, LEAST_DROP)),
        gain_b * math.sqrt(max(drop_b, LEAST_DROP)),
    )


@njit(cache=True, error_model="numpy")
def spool(opening: float, dead_zone: float) -> float:
    """The spool that is `opening` beyond its dead zone."""
    crossing = min(max(opening / OPENING_AT_EDGE, -1.0), 1.0)
    return dead_zone * crossing + opening


@njit(cache=True, error_model="numpy")
def against_play(
    y: float, turned: float, direction: float, play: float
) -> tuple[float, float, float]:
    """The command whose spool is y in spite of its play: half the width ahead, in its direction.

    `turned` is the farthest that y has been in its direction: when it comes back by more than a
    quarter of the play it has turned. Returns command, farthest point and direction.
    """
    if direction * (y - turned) >= 0.0:
        turned = y
    elif abs(y - turned) > 0.25 * play:
        direction, turned = -direction, y
    return y + 0.5 * play * direction, turned, direction
