"""Linkages as they are drawn: pins against the cylinder lengths, parts against the pins."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_model import Machine, RangeError, load_machine
from crane_model.cylinders import cylinder_length
from crane_model.kinematics import link_transforms
from crane_model.machine import parse_pose
from crane_sim import SimulatedCrane
from crane_sim.drawing.bodies import Pins, pins
from crane_sim.drawing.scene import Scene

JOINTS = load_machine().joint_names

MACHINE = load_machine()


def poses() -> st.SearchStrategy[np.ndarray]:
    """(4,) anywhere in Table 2, ends included."""
    limits = [MACHINE.limits[joint] for joint in JOINTS]
    ranges = [st.floats(row.position_min, row.position_max) for row in limits]
    return st.tuples(*ranges).map(np.array)


def sweep(machine: Machine, joint: str, n: int = 200) -> np.ndarray:
    """(n,) positions over the whole range of Table 2."""
    limits = machine.limits[joint]
    return np.linspace(limits.position_min, limits.position_max, n)


def distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.hypot(*(a - b)))


def in_space(point: np.ndarray, slew: float) -> np.ndarray:
    radius, height = point
    return np.array([radius * np.cos(slew), radius * np.sin(slew), height])


def swept_pins(machine: Machine, joint: str) -> list[Pins]:
    moved = np.array(JOINTS) == joint
    return [pins(machine, np.where(moved, value, 0.0)) for value in sweep(machine, joint)]


@pytest.mark.parametrize(
    ("joint", "base", "eye"),
    [("inner_boom", "inner_base", "inner_eye"), ("outer_boom", "outer_base", "outer_eye")],
)
def test_pins_are_a_cylinder_length_apart(
    machine: Machine, joint: str, base: str, eye: str
) -> None:
    drawn = [distance(getattr(p, base), getattr(p, eye)) for p in swept_pins(machine, joint)]
    expected = cylinder_length(machine, joint, sweep(machine, joint))
    np.testing.assert_allclose(drawn, expected, rtol=0.0, atol=1e-12)


def test_links_keep_their_lengths(machine: Machine) -> None:
    linkage = machine.actuators["outer_boom"]
    for p in swept_pins(machine, "outer_boom"):
        lengths = [
            distance(p.lever, p.outer_eye),
            distance(p.rocker, p.outer_eye),
            distance(p.elbow, p.lever),
            distance(p.elbow, p.rocker),
            distance(p.elbow, p.outer_base),
            distance(p.outer_base, p.rocker),
        ]
        expected = [getattr(linkage, key) for key in ("c1", "c2", "s22", "s23", "s31", "s32")]
        np.testing.assert_allclose(lengths, expected, atol=1e-12)


@given(q=poses())
def test_elbow_and_tip_are_those_of_the_kinematics(q: np.ndarray) -> None:
    transforms, drawn = link_transforms(MACHINE, q)[0], pins(MACHINE, q)
    np.testing.assert_allclose(in_space(drawn.elbow, q[0]), transforms[1, :3, 3], atol=1e-12)
    np.testing.assert_allclose(in_space(drawn.tip, q[0]), transforms[3, :3, 3], atol=1e-12)


@pytest.fixture(scope="module")
def scene(simulated: SimulatedCrane, machine: Machine) -> Scene:
    return Scene(simulated, machine)


ENDS = {  # part, and the pins at its origin and on its x axis
    "inner_boom_barrel": ("inner_base", "inner_eye"),
    "inner_boom_rod": ("inner_eye", "inner_base"),
    "outer_boom_barrel": ("outer_base", "outer_eye"),
    "outer_boom_rod": ("outer_eye", "outer_base"),
    "link_1": ("lever", "outer_eye"),
    "link_2": ("rocker", "outer_eye"),
}


@settings(max_examples=50, deadline=None)
@given(q=poses())
def test_drawn_parts_meet_their_pins(scene: Scene, q: np.ndarray) -> None:
    scene.set_pose(q)
    drawn = pins(MACHINE, q)
    for part, (start, end) in ENDS.items():
        body = scene.data.body(part)
        first, last = (in_space(getattr(drawn, name), q[0]) for name in (start, end))
        reached = body.xpos + np.linalg.norm(last - first) * body.xmat.reshape(3, 3)[:, 0]
        np.testing.assert_allclose(body.xpos, first, atol=1e-9)
        np.testing.assert_allclose(reached, last, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(q=poses())
def test_pins_stay_on_the_bodies_that_carry_them(scene: Scene, q: np.ndarray) -> None:
    """MuJoCo's own kinematics carry the pins of the rest pose along with their bodies."""
    carried = {
        "slew": ("inner_base",),
        "inner_boom": ("inner_eye", "outer_base", "rocker"),
        "outer_boom": ("lever",),
    }
    rest = np.array([0.0, 0.2, -1.0, 0.3])
    places = []
    for pose in (rest, q):
        scene.set_pose(pose)
        drawn, local = pins(MACHINE, pose), []
        for name, names in carried.items():
            body = scene.data.body(f"{name} drawn")
            turn = body.xmat.reshape(3, 3).T
            local += [turn @ (in_space(getattr(drawn, n), pose[0]) - body.xpos) for n in names]
        places.append(local)
    np.testing.assert_allclose(places[0], places[1], atol=1e-9)


def test_drawing_adds_no_mass_and_no_contact(scene: Scene, simulated: SimulatedCrane) -> None:
    bodies = simulated.bodies
    total = sum(body.mass for body in bodies.values())
    assert scene.model.body_mass.sum() == pytest.approx(total)
    assert scene.data.ncon == 0


def test_pose_outside_the_joint_limits_is_refused(scene: Scene) -> None:
    with pytest.raises(
        RangeError, match=r"outer_boom: 0\.2 rad is outside its limits \[-2\.7, -0\.1\]"
    ):
        scene.set_pose(np.array([0.0, 0.3, 0.2, 0.4]))


def test_pose_from_words() -> None:
    rest = np.array([0.0, 0.35, -1.5, 0.4])
    np.testing.assert_array_equal(
        parse_pose(["slew=0.3", "telescope=1e-1"], MACHINE, rest), [0.3, 0.35, -1.5, 0.1]
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("boom=1", r"no joint 'boom'; write JOINT=VALUE with a joint of slew, in"),
        ("slew", "'' is not a number; write slew=0.5"),
        ("slew=fast", "'fast' is not a number"),
    ],
)
def test_wrong_pose_is_explained(word: str, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        parse_pose([word], MACHINE, np.zeros(4))
