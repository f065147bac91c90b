"""Regressor of a six-axis robot beside Pinocchio called from Python, in the same run."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from unit.crane_model.pinocchio_chain import pinocchio_chain, random_bodies

from crane_model import Model, Record, load_machine
from crane_model.chain.body_regressor import regressor
from crane_model.terms import Setting
from crane_model.terms.drives import RotorInertia
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.rigid_body import SerialRigidBody
from crane_model.terms.single_axis import Offset

KUKA = Path(__file__).parents[1] / "machines" / "kuka_kr300.yaml"
SAMPLES, REPEATS = 1000, 200
AT_LEAST = 5.0  # times as fast


def test_sixty_columns_are_at_least_five_times_as_fast(measured) -> None:
    """Ten of each body, as Pinocchio has them; and the model of 36 base parameters found by rank
    with rotor, viscous and Coulomb friction and offset of each axis.
    """
    machine = load_machine(KUKA)
    joints = machine.joint_names
    kinds = (RotorInertia, Viscous, Coulomb, Offset)
    terms = (SerialRigidBody(), *(kind(joint=joint) for kind in kinds for joint in joints))
    model = Model("robot", Setting(machine.units, machine), terms)
    assert len(model.parameters) == 60
    q, v, a = np.random.default_rng(22).standard_normal((3, SAMPLES, 6))
    theirs = pinocchio_chain(machine, random_bodies(6, np.random.default_rng(0)))
    data, instants = theirs.createData(), np.arange(SAMPLES) * 0.005

    def by_pinocchio() -> np.ndarray:
        stacked = np.empty((SAMPLES, 6, 60))
        for n in range(SAMPLES):
            stacked[n] = pin.computeJointTorqueRegressor(theirs, data, q[n], v[n], a[n])
        return stacked

    functions: dict[str, Callable[[], np.ndarray]] = {
        "Pinocchio": by_pinocchio,
        "ten parameters a body": lambda: regressor(machine.chain, q, v, a),
        "model of base parameters": lambda: model.regressor(Record(joints, instants, q, v, a)),
    }
    best = dict.fromkeys(functions, np.inf)
    for _ in range(1 + REPEATS):  # in turns, so that what disturbs one disturbs all
        for name, function in functions.items():
            start = time.perf_counter()
            assert function().shape == (SAMPLES, 6, 60)
            best[name] = min(best[name], time.perf_counter() - start)
    theirs_took = best.pop("Pinocchio")
    for name, took in best.items():
        told = f"{SAMPLES / took / 1e6:.2f} million samples/s, {theirs_took / took:.1f} times"
        print(f"\n{name}: {told}")
        target = f"{AT_LEAST:g} times Pinocchio from Python"
        measured(f"six-axis robot, 60 columns, {name}", target, told)
        assert theirs_took / took >= AT_LEAST
