"""Coulomb friction over a step: the force that stops a joint where it can, and else opposes it."""

import numpy as np
from numba import njit

from crane_model.array import Array

_SWEEPS = 1000  # a handful suffices unless two joints move almost as one
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
        for _ in range(_SWEEPS):
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
