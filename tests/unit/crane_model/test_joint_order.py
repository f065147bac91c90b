"""Joints of a model in any order, and only some of them: every result follows its joint."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from laboratory_crane import JOINT_UNITS, JOINTS, PLANAR_JOINTS
from unit.crane_model.test_term_registry import each_type, example, random_record, setting_of

from crane_model import (
    ConfigurationError,
    Machine,
    Model,
    Record,
    generalized_forces,
    lever_arms,
    load_model,
    simulate,
)
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file
from crane_model.record import PER_SAMPLE
from crane_model.terms import Setting

ORDERS = list(permutations(PLANAR_JOINTS))[1:]
WITH_SLEW = ("telescope", "slew", "inner_boom", "outer_boom")


def _places(joints: tuple[str, ...]) -> list[int]:
    return [PLANAR_JOINTS.index(joint) if joint in PLANAR_JOINTS else -1 for joint in joints]


def in_order(record: Record, joints: tuple[str, ...]) -> Record:
    """The record of these joints; one that it does not have moves like its last."""
    at = _places(joints)
    moved = {
        name: value[:, at]
        for name in PER_SAMPLE
        if (value := getattr(record, name)) is not None and value.ndim == 2
    }
    return replace(record, joints=joints, **moved)


@each_type
@pytest.mark.parametrize("joints", [ORDERS[-1], WITH_SLEW], ids=["turned round", "with the slew"])
def test_columns_follow_their_joints(name: str, joints: tuple[str, ...]) -> None:
    if name == "serial_rigid_body" and joints == WITH_SLEW:
        pytest.skip("the slew loads the other joints, and has parameters of its own")
    record, term, without = random_record(), example(name), setting_of(name)
    setting = Setting({joint: JOINT_UNITS[joint] for joint in joints}, without.machine)
    moved, names = (
        [parameter.name for parameter in term.parameters(one)] for one in (setting, without)
    )
    got = term.columns(in_order(record, joints), setting)
    got = got[..., [moved.index(one) for one in names]]  # some have one for each other joint
    expected = term.columns(record, without)[:, _places(joints)]
    expected[:, [joint not in PLANAR_JOINTS for joint in joints]] = 0.0
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_forces_of_cylinders_follow_their_joints(machine: Machine, count: int) -> None:
    """Of any selection in any order, each column is what it is alone."""
    record = in_order(random_record(), JOINTS)
    assert record.pressure_a is not None and record.pressure_b is not None
    every = record.position, record.pressure_a, record.pressure_b
    whole = generalized_forces(machine, *every, JOINTS)
    for joints in permutations(JOINTS, count):
        at = [JOINTS.index(joint) for joint in joints]
        some = [values[:, at] for values in every]
        np.testing.assert_array_equal(generalized_forces(machine, *some, joints), whole[:, at])
        arms = lever_arms(machine, some[0], joints)
        back = cylinder_forces_from_generalized(machine, some[0], whole[:, at], joints)
        np.testing.assert_allclose(back * arms, whole[:, at])


def test_simulated_motion_follows_its_joints() -> None:
    """The packaged crane falls alike, whatever the order of its joints."""
    model = load_model(machine_file("model.yaml"))
    inertial = [480.0, 370.0, 18.0, 450.0, 260.0, 20.0, 150.0, 220.0]
    values = np.array([*inertial, *[500.0, 20.0, 900.0, 30.0] * 3])
    model = model.with_estimate(values, np.zeros(20), "made up")
    start = np.array([[0.4, -1.2, 0.7]]), np.array([[0.1, -0.1, 0.05]])
    drive = np.tile([[[9000.0, -4000.0, 300.0]]], (30, 1, 1))
    expected = simulate(model, *start, drive, 0.01).position
    for joints in ORDERS:
        at = [PLANAR_JOINTS.index(joint) for joint in joints]
        setting = Setting({joint: JOINT_UNITS[joint] for joint in joints}, model.machine)
        turned = Model("turned", setting, model.terms, model.values)
        got = simulate(turned, *(part[:, at] for part in start), drive[:, :, at], 0.01).position
        np.testing.assert_allclose(got, expected[:, :, at], rtol=1e-9)


@pytest.mark.parametrize("joints", ["{telescope: rad}", "{inner_boom: rad, elbow: rad}"])
def test_joints_that_the_machine_does_not_have_are_named(tmp_path: Path, joints: str) -> None:
    path = tmp_path / "model.yaml"
    joint = joints[1 : joints.index(":")]
    path.write_text(
        f"name: x\nmachine: laboratory_crane\njoints: {joints}\n"
        f"terms: [{{type: inertia, joint: {joint}}}]\n"
    )
    with pytest.raises(ConfigurationError, match=r"key 'joints'.*telescope \[m\].*any order; got"):
        load_model(path)
