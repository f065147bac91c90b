"""Oil and pistons of all joints, stepped together while the mechanics is held linear; compiled."""

from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.dry_friction import with_dry_friction
from crane_model.hydraulics.chambers import root, root_slope

RELAXATION = 2e-3  # s in which the supply pressure follows the flow that is drawn; assumed


class Circuit(NamedTuple):
    """Constants of the circuit; arrays (j,), one entry a joint."""

    supply_a: Array  # gains of the metering edges, m3/s/sqrt(Pa)
    a_tank: Array
    supply_b: Array
    b_tank: Array
    bulk_modulus: Array  # Pa
    dead_volume_a: Array  # m3
    dead_volume_b: Array
    leakage: Array  # m3/s/Pa
    area_a: Array  # m2
    area_b: Array
    length_min: Array  # m
    length_max: Array
    supply_pressure: float  # Pa, where nothing is drawn
    droop: float  # Pa s/m3
    tank_pressure: float  # Pa


class Mechanics(NamedTuple):
    """N runs about a state of j joints: M a = tau + load - damping (v - v0) - dry s, s in Sgn(v).

    `cylinder` (N, j, 3): length, lever arm and its derivative at q0.
    """

    position: Array  # (N, j) q0
    velocity: Array  # (N, j) v0
    inverse: Array  # (N, j, j) of M
    load: Array  # (N, j)
    damping: Array  # (N, j, j)
    dry: Array  # (N, j)
    cylinder: Array  # (N, j, 3)


class OilPressures(NamedTuple):
    """Pressures [Pa] of N runs: (N, j), (N, j), (N,). They are stepped in place."""

    chamber_a: Array
    chamber_b: Array
    supply: Array


@njit(cache=True, error_model="numpy")
def _edge(gain: float, drop: float) -> tuple[float, float]:
    """Flow through a metering edge, and its slope against the drop."""
    return gain * root(drop), gain * root_slope(drop)


@njit(cache=True, error_model="numpy")
def _chamber_flows(
    circuit: Circuit, j: int, o: float, p_a: float, p_b: float, supply: float
) -> tuple[float, float, float, float]:
    """Q_A, its slope against p_A, Q_B, its slope against p_B."""
    if o > 0.0:
        q_a, slope_a = _edge(circuit.supply_a[j] * o, supply - p_a)
        q_b, slope_b = _edge(circuit.b_tank[j] * o, p_b - circuit.tank_pressure)
        return q_a, -slope_a, -q_b, -slope_b
    q_a, slope_a = _edge(-circuit.a_tank[j] * o, p_a - circuit.tank_pressure)
    q_b, slope_b = _edge(-circuit.supply_b[j] * o, supply - p_b)
    return -q_a, -slope_a, q_b, -slope_b


@njit(cache=True, error_model="numpy")
def advance(
    circuit: Circuit,
    mechanics: Mechanics,
    openings: Array,
    step: float,
    position: Array,
    velocity: Array,
    oil: OilPressures,
) -> None:
    """As many steps of `step` [s] as `openings` (S, N, j) has, of the state, in place.

    Pressures are linearly implicit, so that a small chamber behind a wide edge stays stable; what a
    piston sweeps is what its length really changed, so that no oil is made or lost.
    """
    steps, runs, joints = openings.shape
    compliance = step * mechanics.inverse
    free = np.empty((runs, joints))
    tau = np.empty(joints)
    for s in range(steps):
        for n in range(runs):
            for j in range(joints):
                arm = mechanics.cylinder[n, j, 1]
                arm += mechanics.cylinder[n, j, 2] * (position[n, j] - mechanics.position[n, j])
                piston = circuit.area_a[j] * oil.chamber_a[n, j]
                piston -= circuit.area_b[j] * oil.chamber_b[n, j]  # (19)
                tau[j] = arm * piston + mechanics.load[n, j]  # (18)
                for i in range(joints):
                    change = velocity[n, i] - mechanics.velocity[n, i]
                    tau[j] -= mechanics.damping[n, j, i] * change
            for j in range(joints):
                free[n, j] = velocity[n, j]
                for i in range(joints):
                    free[n, j] += compliance[n, j, i] * tau[i]
        velocity[:] = with_dry_friction(free, compliance, mechanics.dry)
        for n in range(runs):
            drawn = 0.0
            for j in range(joints):
                before = position[n, j] - mechanics.position[n, j]
                position[n, j] += step * velocity[n, j]
                after = position[n, j] - mechanics.position[n, j]
                x, arm, bend = mechanics.cylinder[n, j]
                x += after * (arm + 0.5 * bend * after)
                growth = (after - before) * (arm + 0.5 * bend * (after + before)) / step
                o, p_a, p_b = openings[s, n, j], oil.chamber_a[n, j], oil.chamber_b[n, j]
                q_a, slope_a, q_b, slope_b = _chamber_flows(circuit, j, o, p_a, p_b, oil.supply[n])
                leak = circuit.leakage[j]
                stiffness = step * circuit.bulk_modulus[j]
                swept = circuit.area_a[j] * (x - circuit.length_min[j])
                k = stiffness / (circuit.dead_volume_a[j] + max(swept, 0.0))
                change = k * (q_a - circuit.area_a[j] * growth - leak * (p_a - p_b))
                change /= 1.0 - k * (slope_a - leak)
                oil.chamber_a[n, j] = max(p_a + change, 0.0)
                if o > 0.0:
                    drawn += q_a + slope_a * change
                swept = circuit.area_b[j] * (circuit.length_max[j] - x)
                k = stiffness / (circuit.dead_volume_b[j] + max(swept, 0.0))
                change = k * (q_b + circuit.area_b[j] * growth + leak * (p_a - p_b))
                change /= 1.0 - k * (slope_b - leak)
                oil.chamber_b[n, j] = max(p_b + change, 0.0)
                if o < 0.0:
                    drawn += q_b + slope_b * change
            target = circuit.supply_pressure - circuit.droop * drawn
            oil.supply[n] += (target - oil.supply[n]) * step / (RELAXATION + step)
