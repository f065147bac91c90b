"""Regressor columns pulled back by weights, against numeric differentiation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crane_model import ConfigurationError, Model, Record, load_machine, load_model
from crane_model.machine_files import machine_file
from crane_model.terms import JointTerm, Parameter, Setting, Term
from crane_model.terms.drives import RotorInertia
from crane_model.terms.friction import Coulomb, CoulombAsymmetry, Viscous, ViscousAsymmetry
from crane_model.terms.rigid_body import SerialRigidBody
from crane_model.terms.single_axis import Offset
from crane_trajectory.excitation.limits import pull_back, smooth_record, smooth_regressor
from crane_trajectory.motion.periodic import MotionSamples

PLANAR_JOINTS = load_machine().joint_names[1:]
MODEL = load_model(machine_file("model.yaml"))
WIDTH = np.array([0.02, 0.05, 0.1])
STEP = 1e-6


class Bent(JointTerm):
    """A term without a closed form in the designer: it uses all that a joint's motion offers."""

    family = "friction"

    def column(self, record: Record, j: int) -> np.ndarray:
        q, v, a = (part[:, j] for part in (record.position, record.velocity, record.acceleration))
        return np.sin(q) * a + record.direction[:, j] * np.exp(-(v**2)) + v * q

    def parameter(self, coordinate, force):
        return Parameter("bent", force, None, "for this test")


class Across(Term):
    """A term of two parameters between joints, with no closed form in the designer."""

    family = "friction"
    of_one_instant = True

    def parameters(self, setting):
        return tuple(Parameter(name, "N", None, "for this test") for name in ("one", "other"))

    def fill(self, record, setting, columns):
        q, v, a = (part.T for part in (record.position, record.velocity, record.acceleration))
        columns[:, 0, 0] = np.sin(q[1]) * a[2] + record.direction[:, 1]
        columns[:, 1, 0] = v[0] * v[2] * np.cos(q[0])
        columns[:, 2, 1] = q[2] * a[0]


class Whole(Term):
    """A term that is not of one instant."""

    family = "friction"

    def parameters(self, setting):
        return (Parameter("whole", "N", None, "for this test"),)

    def fill(self, record, setting, columns):
        columns[:, 0, 0] = np.cumsum(record.velocity[:, 0])


BENT = MODEL.with_term(Bent.model_construct(type="bent", joint="outer_boom"))
ACROSS = MODEL.with_term(Across.model_construct(type="across"))


def random_motion(rng):
    low, high = [-0.45, -2.7, 0.0], [1.37, -0.1, 1.55]
    velocity, acceleration = 0.3 * rng.standard_normal((2, 40, 3))
    return MotionSamples(rng.uniform(low, high, (40, 3)), velocity, acceleration)


def in_space(machine, *without):
    """Rigid bodies, rotors and friction of the joints of a machine."""
    units = {joint: unit for joint, unit in machine.units.items() if joint not in without}
    kinds = (Coulomb, CoulombAsymmetry, Viscous, ViscousAsymmetry, Offset)
    friction = [kind(joint=joint) for joint in units for kind in kinds]
    rotors = [RotorInertia(joint=joint) for joint in machine.rotors]
    return Model("in space", Setting(units, machine), (SerialRigidBody(), *rotors, *friction))


KUKA = load_machine(Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml")
DOUBLE = load_machine("double_telescope_crane")  # two bodies follow one coordinate
IN_SPACE = {
    "six axes": in_space(KUKA),
    "excavator": in_space(load_machine("excavator")),
    "double telescope": in_space(DOUBLE),
    "without slew": in_space(DOUBLE, DOUBLE.joint_names[0]),
    "the parameters (8)": in_space(load_machine(), load_machine().joint_names[0]),
}


@pytest.mark.parametrize("machine", IN_SPACE)
def test_slopes_of_bodies_in_space_are_derivatives(machine):
    """Of a whole motion along random ways, for every machine at once."""
    model, rng = IN_SPACE[machine], np.random.default_rng(6)
    assert all(term.pull_back.__func__ is not Term.pull_back for term, _ in model.whole_terms), (
        "differences would be compared with differences"
    )
    j, width = len(model.joints), rng.uniform(0.02, 0.2, len(model.joints))
    motion = MotionSamples(*rng.standard_normal((3, 30, j)))
    weight = rng.standard_normal((30, j, len(model.parameters)))
    slopes = pull_back(model, smooth_record(model, motion, width), weight, width)

    def weighted(moved):
        record = smooth_record(model, MotionSamples(*moved), width)
        return (weight * smooth_regressor(model, record)).sum(axis=(1, 2))

    for quantity in range(3):
        way = np.zeros((3, 30, j))
        way[quantity] = rng.standard_normal((30, j))
        ends = [weighted(np.array(motion) + sign * STEP * way) for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / (2 * STEP)
        found = (slopes[quantity] * way[quantity]).sum(axis=1)
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(found, numeric, rtol=1e-6, atol=1e-6 * scale)


@pytest.mark.parametrize(
    "model", [MODEL, BENT, ACROSS], ids=["report", "another term", "between joints"]
)
@pytest.mark.parametrize("quantity", range(3))
@pytest.mark.parametrize("joint", range(3))
def test_pull_back_is_the_derivative(model, quantity, joint):
    rng = np.random.default_rng(4)
    motion = random_motion(rng)
    weight = rng.standard_normal((40, 3, len(model.parameters)))
    slopes = pull_back(model, smooth_record(model, motion, WIDTH), weight, WIDTH)

    def weighted(shift):
        moved = [part.copy() for part in motion]
        moved[quantity][:, joint] += shift
        record = smooth_record(model, MotionSamples(*moved), WIDTH)
        return (weight * smooth_regressor(model, record)).sum(axis=(1, 2))

    numeric = (weighted(STEP) - weighted(-STEP)) / (2 * STEP)
    scale = np.abs(numeric).max()
    np.testing.assert_allclose(slopes[quantity][:, joint], numeric, rtol=1e-6, atol=1e-7 * scale)


def test_the_order_of_joints_turns_the_derivative():
    """Of a model whose joints stand the other way round."""
    rng = np.random.default_rng(5)
    motion, weight = random_motion(rng), rng.standard_normal((40, 3, len(MODEL.parameters)))
    joints = dict(reversed(MODEL.setting.units.items()))
    turned = replace(MODEL, setting=MODEL.setting._replace(units=joints))
    record = smooth_record(MODEL, motion, WIDTH)
    expected = pull_back(MODEL, record, weight, WIDTH)
    back = MotionSamples(*(part[:, ::-1] for part in motion))
    got = pull_back(turned, smooth_record(turned, back, WIDTH[::-1]), weight[:, ::-1], WIDTH[::-1])
    for found, wanted in zip(got, expected, strict=True):
        np.testing.assert_allclose(found[:, ::-1], wanted, rtol=1e-12, atol=1e-12)


def test_smoothing_is_narrow():
    motion = random_motion(np.random.default_rng(5))
    motion.velocity[0] = 0.0
    record = smooth_record(MODEL, motion, 1e-4 * WIDTH)
    exact = MODEL.regressor(record)
    np.testing.assert_allclose(smooth_regressor(MODEL, record), exact, atol=1e-5)
    assert (record.direction[0] == 0.0).all()


def test_a_term_that_looks_beyond_the_instant_is_refused():
    model = MODEL.with_term(Whole.model_construct(type="whole"))
    record = smooth_record(model, random_motion(np.random.default_rng(1)), WIDTH)
    with pytest.raises(ConfigurationError, match="term 'whole' depends on more"):
        pull_back(model, record, np.ones((40, len(PLANAR_JOINTS), 21)), WIDTH)
