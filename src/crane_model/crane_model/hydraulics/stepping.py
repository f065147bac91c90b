"""Oil and pistons of all joints stepped together, compiled, the mechanics known at instants."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.array import Array

# Coulomb friction over a step: the force that stops a joint where it can, and else opposes it.

_MAX_SWEEPS = 1000  # a handful suffices unless two joints move almost as one
_TOLERANCE = 1e-12


@njit(cache=True)
def with_dry_friction(free: Array, compliance: Array, dry: Array) -> Array:
    """v = free - compliance (dry s), s in Sgn(v): Gauss-Seidel on the friction force of each joint.

    (N, j), (N, j, j), (N, j). Converges for positive definite compliance.
    """
    velocity = free.copy()
    runs, joints = free.shape
    for n in range(runs):
        force = np.zeros(joints)
        for _ in range(_MAX_SWEEPS):
            largest = 0.0
            for j in range(joints):
                if dry[n, j] == 0.0:
                    continue
                stopping = force[j] + velocity[n, j] / compliance[n, j, j]
                new = min(dry[n, j], max(-dry[n, j], stopping))
                change = new - force[j]
                if change == 0.0:
                    continue
                force[j] = new
                largest = max(largest, abs(change) / dry[n, j])
                for i in range(joints):
                    velocity[n, i] -= compliance[n, i, j] * change
            if largest < _TOLERANCE:
                break
        for j in range(joints):
            if abs(force[j]) < dry[n, j]:
                velocity[n, j] = 0.0  # held: remove what rounding left
    return velocity


# The chambers of a cylinder: what the edges of the valve let in, and what that does.
#
#     V_A/beta p_A' = Q_A - A_A x' - C (p_A - p_B),      V_A = V_0A + A_A (x - x_min)
#     V_B/beta p_B' = Q_B + A_B x' + C (p_A - p_B),      V_B = V_0B + A_B (x_max - x)
#     Q_A =  K_SA o r(p_S - p_A)   where o > 0,     K_AT o r(p_A - p_T)   where o < 0
#     Q_B = -K_BT o r(p_B - p_T)   where o > 0,    -K_SB o r(p_S - p_B)   where o < 0
#     r(d) = d / (d^2 + d_t^2)^(1/4)
#
# with areas A and pressures p of (19), length x of (20) and (24), opening o of `spool`, gains K
# [m3/s/sqrt(Pa)] of the four metering edges fully open, supply p_S and tank p_T, effective bulk
# modulus beta, dead volumes V_0, and laminar leakage C past the piston. r is the orifice law
# sqrt(d), turbulent, made linear below the drop d_t, where it is laminar.
#
# Source: continuity of a compressible chamber and the orifice law, Merritt (1967), ch. 3 and 6;
# the transition after Borutzky, Barnard, Thoma, Simul. Modell. Pract. Theory 10 (2002). The report
# leaves this to future work (its section 5).

LAMINAR_DROP_PA = 1e5
"""Pa, d_t: well below any drop that moves a crane, so that its value hardly matters."""


@njit(cache=True, error_model="numpy")
def root(drop: float) -> float:
    """r(d) [sqrt(Pa)]: odd and increasing."""
    return drop / math.sqrt(math.sqrt(drop * drop + LAMINAR_DROP_PA * LAMINAR_DROP_PA))


@njit(cache=True, error_model="numpy")
def root_slope(drop: float) -> float:
    """dr/dd [1/sqrt(Pa)]."""
    square = drop * drop + LAMINAR_DROP_PA * LAMINAR_DROP_PA
    return (0.5 * drop * drop + LAMINAR_DROP_PA * LAMINAR_DROP_PA) / (
        square * math.sqrt(math.sqrt(square))
    )


def roots(drop: Array) -> Array:
    """r(d) of drops of any shape."""
    found: Array = drop / np.sqrt(np.hypot(drop, LAMINAR_DROP_PA))
    return found


# The spool of a valve: where it stands when, from the commands and when they came.
#
#     u_s(t) = sense u(t - delay),   y'' + 2 D w y' + w^2 (y - u_s) = 0,   |y - z| <= play / 2
#     o = max(0, z - d_A) / (1 - d_A) - max(0, -z - d_B) / (1 - d_B)
#
# u is held from its own stamp until the next; y is the spool, of natural frequency w and damping
# ratio D; z its edges, which trail by the hysteresis; o in -1..1 is the opening beyond the dead
# zones d_A and d_B, positive where supply is open to chamber A. `sense` is +1 where extending the
# cylinder moves the joint in its positive direction, else -1.
#
# Source: second-order servo valve of Merritt, Hydraulic Control Systems (1967), ch. 7, with the
# overlap of ch. 5; the play is the usual backlash operator (Visintin 1994).


@njit(cache=True, error_model="numpy")
def transition(frequency: float, damping: float, time: float) -> tuple[float, float, float, float]:
    """exp(A time) of (y - u, y')' = A (y - u, y'), by rows; exact for a command that is held."""
    decay = damping * frequency
    square = frequency * frequency * (damping * damping - 1.0)
    if square < 0.0:
        turn = math.sqrt(-square)
        even, odd = math.cos(turn * time), math.sin(turn * time) / turn
    elif square > 0.0:
        turn = math.sqrt(square)
        even, odd = math.cosh(turn * time), math.sinh(turn * time) / turn
    else:
        even, odd = 1.0, time
    shrunk = math.exp(-decay * time)
    return (
        shrunk * (even + decay * odd),
        shrunk * odd,
        -shrunk * frequency * frequency * odd,
        shrunk * (even - decay * odd),
    )


@njit(cache=True, error_model="numpy")
def spool_course(
    stamps: Array, commands: Array, times: Array, frequency: float, damping: float
) -> Array:
    """y (n,) at increasing `times` (n,) [s], from commands (m,) held from their `stamps` (m,).

    It rests at the first command until the second one comes. frequency [rad/s].
    """
    out = np.empty(len(times))
    now, target, at, rate = stamps[0], commands[0], commands[0], 0.0
    following = 1
    for k in range(len(times)):
        while following < len(stamps) and stamps[following] <= times[k]:
            step = stamps[following] - now
            a, b, c, d = transition(frequency, damping, step)
            at, rate = target + a * (at - target) + b * rate, c * (at - target) + d * rate
            now, target = stamps[following], commands[following]
            following += 1
        step = times[k] - now
        if step > 0.0:
            a, b, c, d = transition(frequency, damping, step)
            at, rate = target + a * (at - target) + b * rate, c * (at - target) + d * rate
            now = times[k]
        out[k] = at
    return out


@njit(cache=True, error_model="numpy")
def move_spools(
    spools: Array, commands: Array, step: float, frequency: Array, damping: Array, play: Array
) -> Array:
    """z (S, N, j) in the middle of S steps [s] with commands (S, N, j), of N runs of j joints.

    `spools` (3, N, j) is y, y' and z, and is left as it is at the end; the others are (j,).
    """
    steps, runs, joints = commands.shape
    out = np.empty(commands.shape)
    y, rate, edge = spools[0], spools[1], spools[2]
    for j in range(joints):
        half = 0.5 * play[j]
        a, b, c, d = transition(frequency[j], damping[j], 0.5 * step)
        for n in range(runs):
            for s in range(steps):
                target = commands[s, n, j]
                for middle in (True, False):
                    off = y[n, j] - target
                    y[n, j] = target + a * off + b * rate[n, j]
                    rate[n, j] = c * off + d * rate[n, j]
                    edge[n, j] = min(y[n, j] + half, max(y[n, j] - half, edge[n, j]))
                    if middle:
                        out[s, n, j] = edge[n, j]
    return out


@njit(cache=True, error_model="numpy")
def trailing(y: Array, play: float) -> Array:
    """z (n,) of edges that trail a spool y (n,) by half the `play`, from where it begins."""
    out = y.copy()
    half = 0.5 * play
    for k in range(1, len(y)):
        out[k] = min(y[k] + half, max(y[k] - half, out[k - 1]))
    return out


@njit(cache=True, error_model="numpy")
def opening(z: float, dead_band_a: float, dead_band_b: float) -> float:
    """o of edges at z: nothing within the dead bands, 1 or -1 at the end of the stroke."""
    if z > dead_band_a:
        return (z - dead_band_a) / (1.0 - dead_band_a)
    if z < -dead_band_b:
        return (z + dead_band_b) / (1.0 - dead_band_b)
    return 0.0


@njit(cache=True, error_model="numpy")
def openings(z: Array, dead_band_a: float, dead_band_b: float) -> Array:
    """o (n,) of edges at z (n,)."""
    out = np.empty(len(z))
    for k in range(len(z)):
        out[k] = opening(z[k], dead_band_a, dead_band_b)
    return out


SUPPLY_RELAXATION_S = 2e-3  # in which the supply pressure follows the flow that is drawn; assumed


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
        course.supply[k + 1, n] += (target - supply) * step / (SUPPLY_RELAXATION_S + step)
