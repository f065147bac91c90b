"""Joint friction by the report's law (13), set-valued at standstill, or by a dynamic law (LuGre).

`law` is an array (j,) of records, one a joint, with the fields of LAW: Coulomb friction [N m, N]
while the joint moves up (f_c + df_c) and down (f_c - df_c), viscous friction [N m s/rad, N s/m] up
(f_v + df_v) and down (f_v - df_v); for LuGre also those of BRISTLES.
"""

import math

import numpy as np
from numba import njit

LAW = ("coulomb_up", "coulomb_down", "viscous_up", "viscous_down")
BRISTLES = ("stiffness", "damping", "breakaway_ratio", "stribeck_velocity")
STICK, UP, DOWN = 0, 1, -1
SWEEPS = 200  # far above need: the modes settle in a few


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
    for _ in range(SWEEPS):
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
