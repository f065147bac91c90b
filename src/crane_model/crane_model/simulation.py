"""Forward simulation of a model: motion from cylinder forces, many runs side by side.

Coulomb friction at standstill can take any value between its two branches, so each step asks for
the velocity at which the branch fits: sgn(v) where a joint moves, anything in [-1, 1] where it
stands. A joint whose load stays below breakaway therefore stands exactly still.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit

from crane_model.cylinders import lever_arms
from crane_model.errors import RangeError
from crane_model.model_file import Model
from crane_model.record import Record

_SWEEPS = 1000  # a handful suffices unless two joints move almost as one
_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Simulation:
    """Motion of N runs of j joints at T instants."""

    time: np.ndarray  # (T,) s
    position: np.ndarray  # (T, N, j)
    velocity: np.ndarray  # (T, N, j)
    acceleration: np.ndarray  # (T, N, j) mean over the step that led here; 0 at the start
    force: np.ndarray  # (T, N, j) generalized force at these positions, N m or N


def simulate(
    model: Model,
    position: np.ndarray,
    velocity: np.ndarray,
    drive: np.ndarray,
    period: float,
    substeps: int = 2,
) -> Simulation:
    """Move N runs of `model` from a state (N, j), driven by `drive` (T, N, j), T instants apart.

    `drive` holds cylinder forces [N], positive extending, where the model has a machine, and
    generalized forces where it has none; between instants `period` [s] apart it is interpolated.
    Explicit midpoint steps of period / substeps: errors fall with the square of the step while the
    joints slide, and with the step itself where Coulomb friction turns round.

    `RangeError` if the motion leaves the range in which a linkage can be assembled, the drive is
    not finite, or the mass matrix of the model is not positive definite.
    """
    if not np.isfinite(drive).all():
        raise RangeError(f"simulation of '{model.name}': the drive has samples that are not finite")
    step = period / substeps
    q, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    states = [(q, v, np.zeros_like(v))]
    for before, after in pairwise(drive):
        start = v
        for k in range(substeps):
            first, middle = (
                before + (after - before) * (fraction / substeps) for fraction in (k, k + 0.5)
            )
            v_half = _next_velocity(model, q, v, v, first, step / 2)
            q_half = q + step / 4 * (v + v_half)
            v_next = _next_velocity(model, q_half, v_half, v, middle, step)
            q, v = q + step / 2 * (v + v_next), v_next
        states.append((q, v, (v - start) / period))
    positions, velocities, accelerations = (np.stack(parts) for parts in zip(*states, strict=True))
    flat = drive.reshape(-1, drive.shape[-1])
    force = _generalized(model, positions.reshape(flat.shape), flat).reshape(drive.shape)
    time = period * np.arange(len(drive))
    return Simulation(time, positions, velocities, accelerations, force)


def _next_velocity(
    model: Model,
    q: np.ndarray,
    v: np.ndarray,
    v_start: np.ndarray,
    drive: np.ndarray,
    step: float,
) -> np.ndarray:
    """v_start + step M^-1 (tau - rest - dry s) with s in Sgn(result); M and rest at (q, v)."""
    mass, rest, dry = _split(model, q, v)
    inverse = _inverse(model, mass)
    load = _generalized(model, q, drive) - rest
    free = v_start + step * np.einsum("nij,nj->ni", inverse, load)
    return _with_dry_friction(free, step * inverse, np.maximum(dry, 0.0))


def _inverse(model: Model, mass: np.ndarray) -> np.ndarray:
    try:
        root = np.linalg.inv(np.linalg.cholesky(mass))
    except np.linalg.LinAlgError:
        raise RangeError(
            f"simulation of '{model.name}': the mass matrix is not positive definite; either the "
            "inertial values of the model are not physical or the steps are too long for its "
            "friction and the motion has grown without bound"
        ) from None
    return root.transpose(0, 2, 1) @ root


def _split(model: Model, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force of the model as M a + rest + dry s, by evaluating it once on j + 2 stacked cases.

    Being linear in acceleration and in the direction s of motion is all that is asked of a term.
    """
    runs, joints = q.shape
    cases = joints + 2
    acceleration = np.zeros((cases, runs, joints))
    direction = np.zeros((cases, runs, joints))
    for j in range(joints):
        acceleration[j, :, j] = 1.0
    direction[-1] = 1.0
    record = Record(
        joints=model.joints,
        time=np.zeros(cases * runs),
        position=np.tile(q, (cases, 1)),
        velocity=np.tile(v, (cases, 1)),
        acceleration=acceleration.reshape(-1, joints),
        direction_known=direction.reshape(-1, joints),
    )
    force = model.predict(record).reshape(cases, runs, joints)
    rest = force[-2]
    mass = (force[:joints] - rest).transpose(1, 2, 0)
    return mass, rest, force[-1] - rest


def _generalized(model: Model, q: np.ndarray, drive: np.ndarray) -> np.ndarray:
    if model.machine is None:
        return drive
    return drive * lever_arms(model.machine, q)


@njit(cache=True)
def _with_dry_friction(free: np.ndarray, compliance: np.ndarray, dry: np.ndarray) -> np.ndarray:
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
