"""Paths of the tip: on their lines and arcs, within the limits, from rest to rest."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from crane_model import ConfigurationError, RangeError, load_machine, tip_position
from crane_model.machine_files import machine_file
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.motion.check import TipClearance, pump_flow
from crane_trajectory.motion.motion import RUN_UP, Phase
from crane_trajectory.motion.points import PointsTrajectory
from crane_trajectory.motion.tip_path import Arc, StraightLine, plan_tip_path

MACHINE = load_machine()
CLEARANCE = load_clearance(machine_file("clearance.yaml"))
START = np.array([0.2, 0.5, -1.0, 0.6])
HERE = tip_position(MACHINE, START[np.newaxis])[0]
AHEAD = np.array([np.cos(START[0]), np.sin(START[0]), 0.0])
UP = np.array([0.0, 0.0, 1.0])


def densely(trajectory: PointsTrajectory, count: int = 4001) -> tuple[np.ndarray, ...]:
    time = np.linspace(0.0, trajectory.period, count)
    return time, *trajectory.evaluate(time)


def test_the_tip_stays_on_a_line_at_the_speed_that_was_asked_for() -> None:
    end = HERE + 0.8 * AHEAD - 0.2 * UP
    path = plan_tip_path(MACHINE, START, [StraightLine(end)], speed=0.2, acceleration=0.3)
    time, position, *_ = densely(path.trajectory)
    tip = tip_position(MACHINE, position)
    along = (end - HERE) / np.linalg.norm(end - HERE)
    beside = (tip - HERE) - np.outer((tip - HERE) @ along, along)
    assert np.abs(beside).max() < 1e-3
    np.testing.assert_allclose(tip[-1], end, atol=1e-5)
    speed = np.gradient((tip - HERE) @ along, time)
    assert speed.max() == pytest.approx(0.2, rel=0.01)
    assert np.abs(np.gradient(speed, time)).max() < 0.3 * 1.1
    assert path.length == pytest.approx(np.linalg.norm(end - HERE))
    assert path.limited_by == ""


def test_an_arc_is_round_and_goes_through_its_point() -> None:
    middle, across = HERE + 0.4 * UP, np.cross(UP, AHEAD)
    through = middle + 0.4 * across
    segments = [Arc(through, middle + 0.4 * UP)]
    path = plan_tip_path(MACHINE, START, segments, speed=0.3, acceleration=0.5)
    _, position, *_ = densely(path.trajectory)
    tip = tip_position(MACHINE, position)
    np.testing.assert_allclose(np.linalg.norm(tip - middle, axis=1), 0.4, atol=1e-3)
    assert np.linalg.norm(tip - through, axis=1).min() < 2e-3
    assert path.length == pytest.approx(0.4 * np.pi, rel=1e-3)


def test_the_tip_stops_at_corners_and_nowhere_else() -> None:
    corner = HERE + 0.3 * UP
    straight_on = [StraightLine(corner), StraightLine(corner + 0.3 * UP)]
    around = [StraightLine(corner), StraightLine(corner + 0.3 * AHEAD)]
    for segments, stops in ((straight_on, 0), (around, 1)):
        path = plan_tip_path(MACHINE, START, segments, speed=0.1, acceleration=0.2)
        _, _, velocity, _ = densely(path.trajectory)
        slow = np.abs(velocity[1:-1]).max(axis=1) < 2e-3
        inside = slow[200:-200]
        assert np.count_nonzero(np.diff(inside.astype(int)) == 1) == stops


@settings(max_examples=12, deadline=None)
@given(
    name=st.sampled_from(["laboratory_crane", "double_telescope_crane", "excavator"]),
    share=st.lists(st.floats(0.3, 0.7), min_size=4, max_size=4),
    turn=st.floats(0.0, 2.0 * np.pi),
    rise=st.floats(-0.5, 0.5),
    speed=st.floats(0.02, 3.0),
)
def test_no_limit_of_a_machine_is_passed(
    name: str, share: list[float], turn: float, rise: float, speed: float
) -> None:
    machine = load_machine(name)
    limits = [machine.limits[joint] for joint in machine.joint_names]
    low = np.array([limit.position_min for limit in limits])
    high = np.array([limit.position_max for limit in limits])
    start = low + np.array(share) * (high - low)
    here = tip_position(machine, start[np.newaxis])[0]
    end = here + 0.25 * np.array([np.cos(turn), np.sin(turn), rise])
    try:
        path = plan_tip_path(machine, start, [StraightLine(end)], speed, acceleration=1.0)
    except RangeError as error:
        assert "at the end of the range" in str(error)
        return
    time, position, velocity, acceleration = densely(path.trajectory)
    assert (position >= low).all() and (position <= high).all()
    fastest = [limit.velocity_max for limit in limits], [limit.velocity_min for limit in limits]
    assert (velocity <= fastest[0]).all() and (velocity >= fastest[1]).all()
    if machine.supply:
        flow = pump_flow(machine, machine.joint_names, position, velocity)
        assert flow.max() <= machine.supply.pump_flow
    assert path.speed <= speed * (1.0 + 1e-9)
    np.testing.assert_array_equal(position[0], start)
    np.testing.assert_allclose(velocity[[0, -1]], 0.0, atol=1e-9)
    tip = tip_position(machine, position)
    along = (end - here) / np.linalg.norm(end - here)
    assert np.abs((tip - here) - np.outer((tip - here) @ along, along)).max() < 2e-3
    np.testing.assert_allclose(np.gradient(position, time, axis=0), velocity, atol=5e-3)
    np.testing.assert_allclose(
        np.gradient(velocity, time, axis=0)[2:-2], acceleration[2:-2],
        atol=0.05 * max(1.0, np.abs(acceleration).max()),
    )  # fmt: skip


def test_a_faster_path_is_slowed_down_and_says_by_what() -> None:
    end = HERE + 0.5 * UP
    path = plan_tip_path(MACHINE, START, [StraightLine(end)], speed=5.0, acceleration=10.0)
    assert path.speed < 1.0
    assert path.limited_by in {"pump flow", "speed of inner_boom", "speed of outer_boom"}


def test_of_two_poses_the_one_with_the_least_flow_is_taken() -> None:
    """A little outwards: the telescope alone would need more than twice the flow of the booms."""
    end = HERE + 0.3 * AHEAD
    path = plan_tip_path(MACHINE, START, [StraightLine(end)], speed=0.2, acceleration=0.3)
    _, position, velocity, _ = densely(path.trajectory)
    used = pump_flow(MACHINE, MACHINE.joint_names, position, velocity).max()
    alone = np.zeros((1, 4))
    outwards = tip_position(MACHINE, START + np.array([0, 0, 0, 1e-6])) - HERE
    alone[0, 3] = 0.2 / (outwards[0] @ AHEAD / 1e-6)
    assert used < 1.3 * pump_flow(MACHINE, MACHINE.joint_names, START[np.newaxis], alone)[0]


@pytest.mark.parametrize(
    ("segments", "reason"),
    [
        ([], "no segment"),
        ([StraightLine(HERE)], "segment 1 ends 0 m from where it begins, at least 0.001 m"),
        ([Arc(HERE + 0.1 * UP, HERE + 0.2 * UP)], "lie on a line"),
        ([StraightLine(HERE + 9.0 * AHEAD)], "the tip can follow it for"),
    ],
)
def test_what_cannot_be_followed_is_refused(
    segments: list[StraightLine | Arc], reason: str
) -> None:
    with pytest.raises(RangeError, match=reason):
        plan_tip_path(MACHINE, START, segments, speed=0.1, acceleration=0.1)


def test_how_far_the_tip_comes_is_true() -> None:
    far = [StraightLine(HERE + 9.0 * AHEAD)]
    with pytest.raises(RangeError) as refused:
        plan_tip_path(MACHINE, START, far, speed=0.1, acceleration=0.1)
    reach = float(str(refused.value).split("follow it for ")[1].split(" m")[0])
    near = [StraightLine(HERE + 0.97 * reach * AHEAD)]
    plan_tip_path(MACHINE, START, near, speed=0.1, acceleration=0.1)


def test_a_point_by_distance_and_height_is_in_the_plane_of_the_boom() -> None:
    tip_clearance = TipClearance(MACHINE)
    point = tip_clearance.point(START, 3.5, 1.25)
    assert point @ np.cross(UP, AHEAD) == pytest.approx(0.0, abs=1e-9)
    assert point @ AHEAD == pytest.approx(3.5)
    assert point[2] == pytest.approx(1.25)
    there = tip_clearance.at(MACHINE.joint_names, START[np.newaxis])[0]
    np.testing.assert_allclose(tip_clearance.point(START, *there), HERE, atol=1e-9)


# Motion through points, from a file.


def through_points(**changes: object) -> dict[str, object]:
    content: dict[str, object] = {
        "kind": "points",
        "name": "reach",
        "time": [0.0, 2.0, 5.0],
        "joints": {"inner_boom": {"position": [0.5, 0.7, 0.6]}},
    }
    return content | changes


def written(folder: Path, content: dict[str, object]) -> Path:
    import yaml

    file = folder / "points.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def test_a_motion_through_points_runs_once_from_rest_to_rest(tmp_path: Path) -> None:
    trajectory = load_trajectory(written(tmp_path, through_points()))
    start = np.array([0.2, 0.4, -1.0, 0.6])
    motion = plan(MACHINE, trajectory, start, 1, CLEARANCE)
    assert motion.duration == pytest.approx(motion.approach_time + 5.0)
    assert motion.phase(motion.approach_time + 1.0) is Phase.EXCITATION
    time = np.linspace(-0.5, motion.duration + 0.5, 3000)
    reference = motion.reference(time)
    at = np.array([motion.at(instant) for instant in time])
    np.testing.assert_allclose(at[:, 0], reference.position, atol=1e-12)
    np.testing.assert_allclose(at[:, 1], reference.velocity, atol=1e-12)
    np.testing.assert_allclose(
        np.gradient(reference.position, time, axis=0), reference.velocity, atol=2e-3
    )
    passed = motion.reference(motion.approach_time + np.array([0.0, 2.0, 5.0])).position[:, 1]
    np.testing.assert_allclose(passed, [0.5, 0.7, 0.6], atol=1e-12)
    np.testing.assert_array_equal(reference.velocity[[0, -1]], 0.0)
    assert motion.duration < RUN_UP + motion.approach_time + 5.0
    with pytest.raises(RangeError, match="run once, got 2"):
        plan(MACHINE, trajectory, start, 2, CLEARANCE)


def test_points_with_velocities_are_joined_as_by_ros2_control(tmp_path: Path) -> None:
    joint = {"position": [0.5, 0.7, 0.6], "velocity": [0.0, 0.05, 0.0]}
    file = written(tmp_path, through_points(joints={"inner_boom": joint}))
    time = np.linspace(0.0, 5.0, 300)
    cubic = CubicHermiteSpline([0.0, 2.0, 5.0], joint["position"], joint["velocity"])
    samples = load_trajectory(file).evaluate(time)
    np.testing.assert_allclose(samples.position[:, 0], cubic(time), atol=1e-12)
    np.testing.assert_allclose(samples.velocity[:, 0], cubic(time, 1), atol=1e-12)


def test_a_planned_path_is_the_same_from_its_file(tmp_path: Path) -> None:
    from crane_model.configuration import save

    path = plan_tip_path(
        MACHINE, START, [StraightLine(HERE + 0.2 * UP)], speed=0.1, acceleration=0.2
    )
    save(tmp_path / "path.yaml", path.trajectory)
    assert load_trajectory(tmp_path / "path.yaml") == path.trajectory


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"time": [0.0, 2.0, 2.0]}, "increase from 0"),
        ({"time": [1.0, 2.0, 3.0]}, "increase from 0"),
        ({"time": [0.0, 2.0, 5.0, 6.0]}, "3 values for 4 times"),
        (
            {"joints": {"slew": {"position": [0, 0, 0], "velocity": [0, 0, 0.1]}}},
            "must be 0 at the first and at the last point, got 0 and 0.1",
        ),
        (
            {"joints": {"slew": {"position": [0, 0, 0], "acceleration": [0, 0, 0]}}},
            "all need the same",
        ),
    ],
)
def test_wrong_points_are_refused(tmp_path: Path, changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        load_trajectory(written(tmp_path, through_points(**changes)))
