"""(27) reading by reading: generalized forces from pressures at single instants, compiled."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.actuators.actuator import BuiltIn
from crane_model.array import Array
from crane_model.cylinders import actuator_shares, generalized_forces
from crane_model.linkages import motion
from crane_model.machine import Machine


class _Chambers(NamedTuple):
    """Linkages and areas of the cylinders of k joints."""

    kind: NDArray[np.int64]  # (k,)
    constants: Array  # (k, c), as many as that kind has
    area_a: Array  # (k,)
    area_b: Array
    shares: Array  # (k, k) what each cylinder sees of the coordinates


class ChamberForces:
    """What `generalized_forces` gives of k joints in any order, for one instant at a time.

    Actuators of a class of one's own take as long as there.
    """

    def __init__(self, machine: Machine, joints: Sequence[str]):
        self._machine, self._joints = machine, joints
        self._chambers: _Chambers | None = None
        actuators = [machine.actuators[joint] for joint in joints]
        linkages = [one.compiled for one in actuators if isinstance(one, BuiltIn)]
        if len(linkages) < len(joints) or not all(one.has_chambers for one in actuators):
            return
        cylinders = [machine.cylinders[joint] for joint in joints]
        constants = np.zeros((len(joints), max(len(one.constants) for one in linkages)))
        for row, linkage in zip(constants, linkages, strict=True):
            row[: len(linkage.constants)] = linkage.constants
        shares = actuator_shares(machine, joints)
        self._chambers = _Chambers(
            np.array([one.kind for one in linkages]),
            constants,
            np.array([one.area_a for one in cylinders]),
            np.array([one.area_b for one in cylinders]),
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
        one: Array = generalized_forces(
            self._machine, position[np.newaxis], *chambers, self._joints
        )[0]
        return one


@njit(cache=True)
def _set_forces(chambers: _Chambers, position: Array, pressures: Array, force: Array) -> bool:
    """Add to `force` (k,), which comes as zeros; False where something is not finite."""
    k = len(force)
    for i in range(k):
        seen = 0.0
        for j in range(k):
            seen += chambers.shares[i, j] * position[j]
        _, lever, slope = motion(chambers.kind[i], chambers.constants[i], seen)
        own = chambers.area_a[i] * pressures[i] - chambers.area_b[i] * pressures[k + i]
        if not np.isfinite(own + lever + slope):
            return False
        for j in range(k):
            force[j] += chambers.shares[i, j] * (lever * own)
    return True
