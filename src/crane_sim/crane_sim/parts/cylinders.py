"""Actuators, oil and friction of the plant, as compiled functions."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.linkages import motion

# The actuators in the machine: lengths and lever arms at a pose, and the ends of their strokes.
#
# The linkages are those of `crane_model.linkages`: geometry is known to both sides.


class Linkages(NamedTuple):
    """x(q) of the actuators of j joints, as `crane_model.linkages.motion` takes it."""

    kind: np.ndarray  # (j,) int
    begin: np.ndarray  # (j,) int: where in `constants` its own begin,
    end: np.ndarray  # (j,) int: and end
    constants: np.ndarray


CYLINDER_FIELDS = (
    "area_a",
    "area_b",
    "filled_a",
    "filled_b",
    "length_min",
    "length_max",
    "dead_volume_a",
    "dead_volume_b",
    "leakage",
    "stop_stiffness",
    "stop_damping",
)
"""Fields of a cylinder's record: m2, also of what its stroke fills (0 of a motor); m; m3 with hose;
m3/s/Pa past the piston; N/m; s/m. Of a motor m3/rad in the place of m2, rad in the place of m."""


@njit(cache=True, error_model="numpy")
def set_lengths_and_levers(linkages: Linkages, q: np.ndarray, actuators: np.ndarray) -> None:
    """Lengths x(q) [m], lever arms dx/dq and their slopes at the pose q (j,), into records (j,)."""
    for i in range(len(q)):
        actuator = actuators[i]
        constants = linkages.constants[linkages.begin[i] : linkages.end[i]]
        actuator.length, actuator.lever, actuator.slope = motion(linkages.kind[i], constants, q[i])


@njit(cache=True, error_model="numpy")
def stop_force(cylinder: np.record, length: float, rate: float) -> float:
    """Force of the end stops on the piston [N], positive extending (Hunt and Crossley).

    Stiffness times depth, damped in proportion to the depth: no jump at the touch, never a pull.
    """
    if length < cylinder.length_min:
        depth, closing, sign = cylinder.length_min - length, -rate, 1.0
    elif length > cylinder.length_max:
        depth, closing, sign = length - cylinder.length_max, rate, -1.0
    else:
        return 0.0
    damped = max(1.0 + cylinder.stop_damping * closing, 0.0)
    return sign * cylinder.stop_stiffness * depth * damped


# Oil: servo valves, orifices, chambers, pump and relief valve, as compiled scalar functions.
#
# Pressures are gauge [Pa], flows [m3/s]. Spool opening x in -1..1: positive opens supply to chamber
# A and chamber B to tank.

EDGES = ("supply_a", "a_tank", "supply_b", "b_tank")
"""The metering edges of a valve, by what they join."""
VALVE_FIELDS = ("sense", "frequency", "damping_ratio", "rate_limit", "dead_band", "null", *EDGES)
"""Fields of a valve's record. `sense` is +1 where extending the cylinder moves the joint in its
positive direction, else -1; frequency [rad/s] of the undamped spool; rate_limit [strokes/s];
dead_band [strokes] to either side of `null` [strokes]; of each edge the gain, fully open
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
    port_relief: float  # Pa, where that of a chamber opens
    load_sensing: bool  # whether pump and valves follow the highest load; see `load_pressure`
    margin: float  # Pa above it
    power: float  # W, most that the pump takes


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
def opening(position: float, dead_band: float) -> float:
    """Metering opening in -1..1 of a spool with overlap: zero inside the dead band."""
    if abs(position) <= dead_band:
        return 0.0
    return (position - math.copysign(dead_band, position)) / (1.0 - dead_band)


@njit(cache=True, error_model="numpy")
def conductances(valve: np.record, x: float) -> tuple[float, float]:
    """Conductances to chambers A and B at a metering opening x [m3/s/sqrt(Pa)]: see `port_flow`."""
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
    or leaks, or leaves through the relief valve of the port. `growth` is V'. Linearly implicit in
    p, so that a small chamber behind a wide orifice stays stable.
    """
    if p < oil.tank_pressure:
        root, check_slope = signed_root(oil.tank_pressure - p, oil.laminar_drop)
        flow += oil.check_valve_gain * root
        slope -= oil.check_valve_gain * check_slope
    over = oil.relief_gain * max(p - oil.port_relief, 0.0)
    over_slope = oil.relief_gain if over > 0.0 else 0.0
    elasticity = step * oil.bulk_modulus / volume
    change = elasticity * (flow - over - growth - leakage * (p - p_other))
    change /= 1.0 - elasticity * (slope - over_slope - leakage)
    return p + change, flow + slope * change


COMPENSATOR_DROOP_PA = 2.0e8  # at which a compensator would pass nothing; far above any pressure


@njit(cache=True, error_model="numpy")
def compensated_flow(
    oil: Oil, conductance: float, p_supply: float, p_load: float, p: float
) -> tuple[float, float]:
    """As `port_flow`, of an edge that feeds with a compensator behind it (flow sharing).

    The drop at the edge is the supply over the highest load `p_load` [Pa], that of all edges that
    feed. A real compensator passes a little less the higher the pressure behind it. A check valve
    keeps the oil of a chamber that is above the supply.
    """
    if p >= p_supply:
        return 0.0, 0.0
    root, slope = signed_root(max(p_supply - max(p_load, p), 0.0), oil.laminar_drop)
    kept = max(1.0 - p / COMPENSATOR_DROOP_PA, 0.0)
    slope = -slope * kept if p >= p_load else 0.0
    return conductance * root * kept, conductance * (slope - root / COMPENSATOR_DROOP_PA)


@njit(cache=True, error_model="numpy")
def set_pressure(oil: Oil, p_load: float) -> float:
    """Pressure at which the pump delivers nothing [Pa]: its own, or above that of the load."""
    if not oil.load_sensing:
        return oil.set_pressure
    return min(p_load + oil.margin + 0.5 * oil.droop, oil.set_pressure)


@njit(cache=True, error_model="numpy")
def pump_flow(oil: Oil, p_supply: float, p_load: float) -> float:
    """Delivery of the pressure-controlled pump, from none to all it can: flow or power."""
    most = oil.pump_flow
    if oil.load_sensing:
        most = min(most, oil.power / max(p_supply, oil.margin))
    short = (set_pressure(oil, p_load) - p_supply) / oil.droop
    return most * min(max(short, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def relief_flow(oil: Oil, p_supply: float, p_load: float) -> float:
    """Flow that relief valve, or with load sensing the unloading valve, returns to tank."""
    opens = oil.relief_pressure
    if oil.load_sensing:
        opens = min(opens, set_pressure(oil, p_load) + 0.5 * oil.droop)
    return oil.relief_gain * max(p_supply - opens, 0.0)


# Joint friction by the report's law (13), set-valued at standstill, or by a dynamic law (LuGre).
#
# `law` is an array (j,) of records, one a joint, with the fields of LAW_FIELDS: Coulomb friction [N
# m, N] while the joint moves up (f_c + df_c) and down (f_c - df_c), viscous friction [N m s/rad, N
# s/m] up (f_v + df_v) and down (f_v - df_v); for LuGre also those of BRISTLE_FIELDS.

LAW_FIELDS = ("coulomb_up", "coulomb_down", "viscous_up", "viscous_down")
BRISTLE_FIELDS = ("stiffness", "damping", "breakaway_ratio", "stribeck_velocity")
STICK, UP, DOWN = 0, 1, -1
MAX_SWEEPS = 200  # far above need: the modes settle in a few


@njit(cache=True, error_model="numpy")
def solve_symmetric(matrix: np.ndarray, x: np.ndarray) -> None:
    """Solve matrix (j, j) x = rhs by LDL^T; x holds rhs, the lower triangle is overwritten."""
    n = len(x)
    for j in range(n):
        reciprocal = 1.0 / matrix[j, j]
        for i in range(j + 1, n):
            factor = matrix[i, j] * reciprocal
            for k in range(i, n):
                matrix[k, i] -= factor * matrix[k, j]
            x[i] -= factor * x[j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= matrix[k, i] * x[k]
        x[i] /= matrix[i, i]


@njit(cache=True, error_model="numpy")
def _velocity_for_modes(
    law: np.ndarray,
    mass: np.ndarray,
    impulse: np.ndarray,
    step: float,
    mode: np.ndarray,
    scratch: np.ndarray,
    v: np.ndarray,
) -> bool:
    """Solve for v with each joint sticking, moving up or down; whether v and forces agree with it.

    Sticking joints leave the equations; their friction must then lie within the breakaway limits.
    """
    for i in range(len(v)):
        if mode[i] == STICK:
            v[i] = 0.0
            for j in range(len(v)):
                scratch[i, j] = 0.0
                scratch[j, i] = 0.0
            scratch[i, i] = 1.0
            continue
        for j in range(i + 1):
            scratch[i, j] = 0.0 if mode[j] == STICK else mass[i, j]
        if mode[i] == UP:
            scratch[i, i] += step * law[i].viscous_up
            v[i] = impulse[i] - step * law[i].coulomb_up
        else:
            scratch[i, i] += step * law[i].viscous_down
            v[i] = impulse[i] + step * law[i].coulomb_down
    solve_symmetric(scratch, v)
    for i in range(len(v)):
        if mode[i] == STICK:
            rest = impulse[i]
            for j in range(len(v)):
                rest -= mass[i, j] * v[j]
            if rest > step * law[i].coulomb_up or rest < -step * law[i].coulomb_down:
                return False
        elif mode[i] * v[i] <= 0.0:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _sweep(
    law: np.ndarray,
    mass: np.ndarray,
    impulse: np.ndarray,
    step: float,
    mode: np.ndarray,
    v: np.ndarray,
) -> None:
    """One projected Gauss-Seidel sweep: each joint in turn takes the mode that fits the others."""
    for i in range(len(v)):
        rest = impulse[i] + mass[i, i] * v[i]
        for j in range(len(v)):
            rest -= mass[i, j] * v[j]
        up, down = step * law[i].coulomb_up, step * law[i].coulomb_down
        if rest > up:
            mode[i] = UP
            v[i] = (rest - up) / (mass[i, i] + step * law[i].viscous_up)
        elif rest < -down:
            mode[i] = DOWN
            v[i] = (rest + down) / (mass[i, i] + step * law[i].viscous_down)
        else:
            mode[i] = STICK
            v[i] = 0.0


@njit(cache=True, error_model="numpy")
def step_set_valued(
    law: np.ndarray,
    mass: np.ndarray,
    impulse: np.ndarray,
    step: float,
    mode: np.ndarray,
    scratch: np.ndarray,
    v: np.ndarray,
) -> None:
    """Velocity after one implicit step with friction (13): M v + step * friction(v) = impulse.

    friction(v) is set-valued: at v = 0 any value from -coulomb_down to coulomb_up. The solution
    minimises a strictly convex function, so it is unique: the modes of the last step (`mode`,
    updated) are tried first, and sweeps find them anew when they no longer hold. `impulse` (j,) is
    M v_old + step * (all other forces); `v` is warm start and result; `scratch` (j + 1, j) is
    overwritten.
    """
    factor, trial = scratch[: len(v)], scratch[len(v)]
    for _ in range(MAX_SWEEPS):
        if _velocity_for_modes(law, mass, impulse, step, mode, factor, trial):
            for i in range(len(v)):
                v[i] = trial[i]
            return
        _sweep(law, mass, impulse, step, mode, v)


@njit(cache=True, error_model="numpy")
def lugre_force(law: np.record, v: float, z: float, step: float) -> tuple[float, float]:
    """LuGre friction force of one joint and the bristle deflection z [rad, m] after one step.

    z' = v - sigma_0 |v| z / g(v), F = sigma_0 z + sigma_1 z' + viscous; g decays from breakaway to
    Coulomb friction over the Stribeck velocity. z is stepped implicitly, so no step is too long.
    """
    coulomb = law.coulomb_up if v >= 0.0 else law.coulomb_down
    viscous = law.viscous_up if v >= 0.0 else law.viscous_down
    excess = (law.breakaway_ratio - 1.0) * coulomb
    level = coulomb + excess * math.exp(-((v / law.stribeck_velocity) ** 2))
    z_new = (z + step * v) / (1.0 + step * law.stiffness * abs(v) / level)
    force = law.stiffness * z_new + law.damping * (z_new - z) / step + viscous * v
    return force, z_new


@njit(cache=True, error_model="numpy")
def step_lugre(
    law: np.ndarray,
    mass: np.ndarray,
    impulse: np.ndarray,
    step: float,
    z: np.ndarray,
    scratch: np.ndarray,
    v: np.ndarray,
) -> None:
    """Velocity after one step with LuGre friction: deflections z (j,) and v (j,) are updated."""
    for i in range(len(v)):
        force, z[i] = lugre_force(law[i], v[i], z[i], step)
        for j in range(len(v)):
            scratch[i, j] = mass[i, j]
        v[i] = impulse[i] - step * force
    solve_symmetric(scratch[: len(v)], v)
