"""Oil and pistons of all joints stepped together, compiled, the mechanics known at instants."""

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
    growth_a: Array  # m2, as of `Chambers`
    growth_b: Array
    empty_a: Array  # m
    empty_b: Array
    supply_pressure: float  # Pa, where nothing is drawn
    droop: float  # Pa s/m3
    tank_pressure: float  # Pa


def chamber_volumes(circuit: Circuit, length: Array) -> tuple[Array, Array]:
    """Oil (j,) [m3] in chambers A and B at cylinder lengths (j,) [m]."""
    return (
        circuit.dead_volume_a + circuit.growth_a * (length - circuit.empty_a),
        circuit.dead_volume_b + circuit.growth_b * (circuit.empty_b - length),
    )


class Mechanics(NamedTuple):
    """N runs about T states of j joints: M a = tau + load - damping (v - v0) - dry s, s in Sgn(v).

    `cylinder` (T, N, j, 3): length, lever arm and its derivative at q0.
    """

    position: Array  # (T, N, j) q0
    velocity: Array  # (T, N, j) v0
    inverse: Array  # (T, N, j, j) of M
    load: Array  # (T, N, j)
    damping: Array  # (T, N, j, j)
    dry: Array  # (T, N, j)
    cylinder: Array  # (T, N, j, 3)


class CraneCourse(NamedTuple):
    """N runs of j joints at T + 1 instants, the first of them given."""

    position: Array  # (T + 1, N, j) rad or m
    velocity: Array  # (T + 1, N, j)
    chamber_a: Array  # (T + 1, N, j) Pa
    chamber_b: Array  # (T + 1, N, j) Pa
    supply: Array  # (T + 1, N) Pa


@njit(cache=True, error_model="numpy")
def _edge(gain: float, drop: float) -> tuple[float, float]:
    """Flow through a metering edge, and its slope against the drop."""
    return gain * root(drop), gain * root_slope(drop)


@njit(cache=True, error_model="numpy")
def chamber_flows(
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
    circuit: Circuit, mechanics: Mechanics, openings: Array, step: float, course: CraneCourse
) -> None:
    """The course from its first instant on, by the mechanics at each; it is written in place.

    `openings` (T, S, N, j): of S steps of `step` [s] from each instant to the next.
    """
    instants, steps = openings.shape[:2]
    for k in range(instants):
        for values in (course.position, course.velocity, course.chamber_a, course.chamber_b):
            values[k + 1] = values[k]
        course.supply[k + 1] = course.supply[k]
        compliance = step * mechanics.inverse[k]
        for s in range(steps):
            free = _driven(circuit, mechanics, k, compliance, course)
            course.velocity[k + 1] = with_dry_friction(free, compliance, mechanics.dry[k])
            _fill(circuit, mechanics, k, openings[k, s], step, course)


@njit(cache=True, error_model="numpy")
def _driven(
    circuit: Circuit, mechanics: Mechanics, k: int, compliance: Array, course: CraneCourse
) -> Array:
    """Velocities (N, j) that the pressures would bring about without dry friction."""
    runs, joints = mechanics.load[k].shape
    free: Array = course.velocity[k + 1].copy()
    tau = np.empty(joints)
    for n in range(runs):
        q, v = course.position[k + 1, n], course.velocity[k + 1, n]
        for j in range(joints):
            arm = mechanics.cylinder[k, n, j, 1]
            arm += mechanics.cylinder[k, n, j, 2] * (q[j] - mechanics.position[k, n, j])
            piston = circuit.area_a[j] * course.chamber_a[k + 1, n, j]
            piston -= circuit.area_b[j] * course.chamber_b[k + 1, n, j]  # (19)
            tau[j] = arm * piston + mechanics.load[k, n, j]  # (18)
            for i in range(joints):
                tau[j] -= mechanics.damping[k, n, j, i] * (v[i] - mechanics.velocity[k, n, i])
        for j in range(joints):
            for i in range(joints):
                free[n, j] += compliance[n, j, i] * tau[i]
    return free


@njit(cache=True, error_model="numpy")
def _fill(
    circuit: Circuit, mechanics: Mechanics, k: int, opened: Array, step: float, course: CraneCourse
) -> None:
    """Positions and pressures after a step with openings (N, j).

    Pressures are linearly implicit, so that a small chamber behind a wide edge stays stable; what a
    piston sweeps is what its length really changed, so that no oil is made or lost.
    """
    runs, joints = opened.shape
    for n in range(runs):
        drawn, supply = 0.0, course.supply[k + 1, n]
        for j in range(joints):
            begun = mechanics.position[k, n, j]
            before = course.position[k + 1, n, j] - begun
            after = before + step * course.velocity[k + 1, n, j]
            course.position[k + 1, n, j] = begun + after
            x, arm, bend = mechanics.cylinder[k, n, j]
            x += after * (arm + 0.5 * bend * after)
            growth = (after - before) * (arm + 0.5 * bend * (after + before)) / step
            o = opened[n, j]
            p_a, p_b = course.chamber_a[k + 1, n, j], course.chamber_b[k + 1, n, j]
            q_a, slope_a, q_b, slope_b = chamber_flows(circuit, j, o, p_a, p_b, supply)
            leak = circuit.leakage[j]
            swept = circuit.growth_a[j] * (x - circuit.empty_a[j])
            stiffness = step * circuit.bulk_modulus[j]
            stiffness /= circuit.dead_volume_a[j] + max(swept, 0.0)
            change = stiffness * (q_a - circuit.area_a[j] * growth - leak * (p_a - p_b))
            change /= 1.0 - stiffness * (slope_a - leak)
            course.chamber_a[k + 1, n, j] = max(p_a + change, 0.0)
            if o > 0.0:
                drawn += q_a + slope_a * change
            swept = circuit.growth_b[j] * (circuit.empty_b[j] - x)
            stiffness = step * circuit.bulk_modulus[j]
            stiffness /= circuit.dead_volume_b[j] + max(swept, 0.0)
            change = stiffness * (q_b + circuit.area_b[j] * growth + leak * (p_a - p_b))
            change /= 1.0 - stiffness * (slope_b - leak)
            course.chamber_b[k + 1, n, j] = max(p_b + change, 0.0)
            if o < 0.0:
                drawn += q_b + slope_b * change
        target = circuit.supply_pressure - circuit.droop * drawn
        course.supply[k + 1, n] += (target - supply) * step / (RELAXATION + step)
