"""Cylinders (17)-(27) on arrays: length, lever arm, pressures to generalized forces and back."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.actuators import BuiltIn
from crane_model.array import Array
from crane_model.errors import RangeError
from crane_model.linkages import motion
from crane_model.machine import Machine


def cylinder_geometry(machine: Machine, joint: str, q: Array) -> tuple[Array, Array, Array]:
    """Length x [m], lever arm dx/dq and its derivative d2x/dq2 of one cylinder at q (n,).

    Source: (20), (24). Raises `RangeError` where the linkage cannot be assembled or q is not
    finite.
    """
    machine.index(joint)  # or RangeError names the joints
    q = np.asarray(q, dtype=float)
    flat = q.ravel()
    values = machine.cylinder(joint, flat)
    if not np.isfinite(values).all():
        bad = ~np.isfinite(values).all(axis=1)
        limits = machine.limits[joint]
        raise RangeError(
            f"{joint}: the linkage cannot be assembled at q = {flat[bad][0]:.6g} "
            f"{machine.units[joint]}; its range is [{limits.position_min}, {limits.position_max}]"
        )
    length, lever, slope = values.T.reshape(3, *q.shape)
    return length, lever, slope


def cylinder_length(machine: Machine, joint: str, q: Array) -> Array:
    """x(q) [m] of (20), (24); same shape as q.

    >>> from crane_model import load_machine
    >>> cylinder_length(load_machine(), "inner_boom", np.array([0.0, 0.5])).round(3)
    array([0.76 , 0.894])
    """
    return cylinder_geometry(machine, joint, q)[0]


def lever_arm(machine: Machine, joint: str, q: Array) -> Array:
    """dx/dq of (18) [m/rad, or 1]; same shape as q; negative where extending lowers q."""
    return cylinder_geometry(machine, joint, q)[1]


def cylinder_force(machine: Machine, joint: str, pressure_a: Array, pressure_b: Array) -> Array:
    """F = A_A p_A - A_B p_B (19) [N] from chamber pressures [Pa]; positive extends."""
    cylinder = machine.cylinders[joint]
    return cylinder.area_a * np.asarray(pressure_a) - cylinder.area_b * np.asarray(pressure_b)


def lever_arms(machine: Machine, q: Array, joints: Sequence[str]) -> Array:
    """Lever arms dx/dq (18) of the actuators of k joints, in any order.

    Parameters
    ----------
    machine
        The arm.
    q
        (n, k) coordinates of the joints [rad, m].
    joints
        Their names, the columns of q.

    Returns
    -------
    (n, k) lever arms [m/rad, or 1]. Of an actuator that several joints move, at what it sees of
    them.

    Raises
    ------
    RangeError
        If a linkage cannot be assembled at q, or an actuator is also moved by a joint not in
        `joints`.
    """
    shares = actuator_shares(machine, joints)
    columns = zip(joints, (q if shares is None else q @ shares.T).T, strict=True)
    return np.stack([lever_arm(machine, joint, column) for joint, column in columns], axis=1)


def generalized_from_actuators(
    machine: Machine, q: Array, force: Array, joints: Sequence[str]
) -> Array:
    """(18) [N m, N] of k joints in any order from coordinates and forces of actuators, (n, k) each.

    The forces are those of cylinders [N], or the torques of motors on their own side of the gear.
    """
    tau = lever_arms(machine, q, joints) * force
    shares = actuator_shares(machine, joints)
    return tau if shares is None else tau @ shares


def generalized_forces(
    machine: Machine, q: Array, pressure_a: Array, pressure_b: Array, joints: Sequence[str]
) -> Array:
    """Generalized forces (27) of k joints, in any order, from the pressures of their cylinders.

    Parameters
    ----------
    machine
        The arm.
    q
        (n, k) coordinates of the joints [rad, m].
    pressure_a, pressure_b
        (n, k) pressures of the chambers [Pa].
    joints
        Their names, the columns of the arrays.

    Returns
    -------
    (n, k) generalized forces [N m, N].

    Raises
    ------
    RangeError
        If a linkage cannot be assembled at q, or a joint has no hydraulic actuator.
    """
    columns = enumerate(joints)
    forces = [cylinder_force(machine, j, pressure_a[:, i], pressure_b[:, i]) for i, j in columns]
    return generalized_from_actuators(machine, q, np.stack(forces, axis=1), joints)


def cylinder_forces_from_generalized(
    machine: Machine, q: Array, tau: Array, joints: Sequence[str]
) -> Array:
    """Inverse of (27): (n, k) generalized forces of k joints to (n, k) cylinder forces [N]."""
    shares = actuator_shares(machine, joints)
    force = np.asarray(tau) if shares is None else np.asarray(tau) @ np.linalg.inv(shares)
    return force / lever_arms(machine, q, joints)


def actuator_shares(machine: Machine, joints: Sequence[str]) -> Array | None:
    """(k, k) what the actuators of k joints see of each; None where each sees its own alone."""
    if not machine.couplings:
        return None
    shares = np.zeros((len(joints), len(joints)))
    for i, joint in enumerate(joints):
        for mover, share in machine.seen_by(joint).items():
            if mover not in joints:
                raise RangeError(
                    f"the actuator of {joint} is also moved by {mover}, whose coordinate is needed"
                )
            shares[i, joints.index(mover)] = share
    return shares


# (27) reading by reading: generalized forces from pressures at single instants, compiled.


class _Chambers(NamedTuple):
    """Linkages and areas of the cylinders of k joints."""

    kind: NDArray[np.int64]  # (k,)
    constants: Array  # (k, c), as many as that kind has
    area_a: Array  # (k,)
    area_b: Array
    shares: Array  # (k, k) what each cylinder sees of the coordinates


class ChamberForces:
    """The result of `generalized_forces` for k joints in any order, one instant at a time.

    Actuators of classes defined outside the suite take as long as there.
    """

    def __init__(self, machine: Machine, joints: Sequence[str]):
        self._machine, self._joints = machine, joints
        self._chambers: _Chambers | None = None
        actuators = [machine.actuators[joint] for joint in joints]
        linkages = [actuator.compiled for actuator in actuators if isinstance(actuator, BuiltIn)]
        if len(linkages) < len(joints) or not all(actuator.has_chambers for actuator in actuators):
            return
        cylinders = [machine.cylinders[joint] for joint in joints]
        constants = np.zeros((len(joints), max(len(linkage.constants) for linkage in linkages)))
        for row, linkage in zip(constants, linkages, strict=True):
            row[: len(linkage.constants)] = linkage.constants
        shares = actuator_shares(machine, joints)
        self._chambers = _Chambers(
            np.array([linkage.kind for linkage in linkages]),
            constants,
            np.array([cylinder.area_a for cylinder in cylinders]),
            np.array([cylinder.area_b for cylinder in cylinders]),
            np.eye(len(joints)) if shares is None else shares,
        )

    def __call__(self, position: Array, pressures: Array) -> Array:
        """(k,) [N m, N] at coordinates (k,) and pressures (2 k,) [Pa], those of all chambers A
        before those of B. Raises `RangeError` where a linkage cannot be assembled.
        """
        if self._chambers is not None:
            force = np.zeros(len(position))
            if _set_forces(self._chambers, position, pressures, force):
                return force
        k = len(position)
        chambers = pressures[np.newaxis, :k], pressures[np.newaxis, k:]
        forces: Array = generalized_forces(
            self._machine, position[np.newaxis], *chambers, self._joints
        )[0]
        return forces


@njit(cache=True)
def _set_forces(chambers: _Chambers, position: Array, pressures: Array, force: Array) -> bool:
    """Add to `force` (k,), which comes as zeros; False where something is not finite."""
    k = len(force)
    for i in range(k):
        seen = 0.0
        for j in range(k):
            seen += chambers.shares[i, j] * position[j]
        _, lever, slope = motion(chambers.kind[i], chambers.constants[i], seen)
        piston = chambers.area_a[i] * pressures[i] - chambers.area_b[i] * pressures[k + i]
        if not np.isfinite(piston + lever + slope):
            return False
        for j in range(k):
            force[j] += chambers.shares[i, j] * (lever * piston)
    return True
