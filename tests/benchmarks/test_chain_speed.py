"""Regressor of a six-axis robot beside Pinocchio called from Python, in the same run."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from benchmarks.test_regressor_speed import AT_LEAST, best_rate
from unit.crane_model.pinocchio_chain import pinocchio_chain, random_bodies

from crane_model.machine import load_machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Setting
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.rotor_inertia import RotorInertia
from crane_model.terms.serial_rigid_body import SerialRigidBody
from crane_model.terms.single_axis import Offset

KUKA = Path(__file__).parents[1] / "machines" / "kuka_kr300.yaml"


@pytest.mark.parametrize("samples", [1_000, 10_000])
def test_sixty_base_columns_are_at_least_five_times_as_fast(samples: int, measured) -> None:
    """36 of the bodies, found by rank, and rotor, viscous and Coulomb friction, offset per axis."""
    machine = load_machine(KUKA)
    joints = machine.joint_names
    kinds = (RotorInertia, Viscous, Coulomb, Offset)
    terms = (SerialRigidBody(), *(kind(joint=joint) for kind in kinds for joint in joints))
    model = Model("robot", Setting(machine.units, machine), terms)
    assert len(model.parameters) == 60
    q, v, a = np.random.default_rng(22).standard_normal((3, samples, 6))
    theirs = pinocchio_chain(machine, random_bodies(6, np.random.default_rng(0)))
    data, instants = theirs.createData(), np.arange(samples) * 0.005

    def by_pinocchio() -> np.ndarray:
        stacked = np.empty((samples, 6, 60))
        for n in range(samples):
            stacked[n] = pin.computeJointTorqueRegressor(theirs, data, q[n], v[n], a[n])
        return stacked

    pinocchio = best_rate(samples, by_pinocchio)
    ours = best_rate(samples, lambda: model.regressor(Record(joints, instants, q, v, a)))
    ratio = ours / pinocchio
    told = f"{ours / 1e6:.2f} million samples/s, {ratio:.1f} times"
    print(f"\n{samples} samples: {told}")
    measured(
        f"regressor of a six-axis robot, 60 columns, {samples} samples",
        "5 times Pinocchio from Python",
        told,
    )
    assert ratio >= AT_LEAST
