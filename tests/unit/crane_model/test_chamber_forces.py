"""Forces from pressures, one instant at a time, beside those of arrays."""

from collections.abc import Sequence

import numpy as np
import pytest

from crane_model import Machine, RangeError, generalized_forces, load_machine
from crane_model.cylinders import ChamberForces
from crane_model.machine import Coupling

CRANE = load_machine()
SLIDE = Coupling(joints=("inner_boom", "telescope"), matrix=((1.0, 0.2), (0.0, 1.0)))
MACHINES = {
    "laboratory crane": CRANE,
    "excavator": load_machine("excavator"),
    "double telescope": load_machine("double_telescope_crane"),
    "coupled": CRANE.model_copy(update={"couplings": (SLIDE,)}),
}


def instants(machine: Machine, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (20, k) in the middle of their range, pressures (20, 2 k)."""
    rng = np.random.default_rng(3)
    limits = [machine.limits[joint] for joint in joints]
    low, high = np.array([(one.position_min, one.position_max) for one in limits]).T
    q = low + (high - low) * rng.uniform(0.3, 0.7, (20, len(joints)))
    return q, rng.uniform(0.0, 2e7, (20, 2 * len(joints)))


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("order", [1, -1])
def test_the_same_as_of_arrays(name: str, order: int) -> None:
    """To the digit where no sums over joints are in it."""
    machine = MACHINES[name]
    joints = machine.joint_names[::order]
    q, pressures = instants(machine, joints)
    k = len(joints)
    expected = generalized_forces(machine, q, pressures[:, :k], pressures[:, k:], joints)
    forces = ChamberForces(machine, joints)
    found = np.array([forces(*one) for one in zip(q, pressures, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=1e-14 if machine.couplings else 0.0)
    assert np.abs(found).min() > 0.0


def test_where_a_linkage_cannot_be_is_named() -> None:
    forces = ChamberForces(CRANE, ("outer_boom",))
    with pytest.raises(RangeError, match="outer_boom: the linkage cannot be assembled at q = nan"):
        forces(np.array([np.nan]), np.array([1e7, 1e6]))
