"""Sweeps and dwells: continuity, exact speeds, limits, and a designed experiment of them."""

from itertools import pairwise

import numpy as np
import pytest

from crane_model import ConfigurationError, RangeError, load_machine
from crane_model.configuration import save
from crane_model.machine_files import machine_file
from crane_trajectory import (
    Clearance,
    SweepTrajectory,
    load_clearance,
    load_design_settings,
    load_trajectory,
    plan,
)
from crane_trajectory.excitation.sweeps import CORNER, design_sweeps
from crane_trajectory.motion.check import trajectory_violations
from crane_trajectory.motion.periodic import JointCourse

MACHINE = load_machine()
PLANAR_JOINTS = MACHINE.joint_names[1:]
CLEARANCE = load_clearance(machine_file("clearance.yaml"))
MARGINS = load_design_settings(machine_file("design.yaml")).margins
COURSE = JointCourse(time=(0.0, 3.0, 4.0, 5.0, 20.0), position=(0.2, 0.9, 0.9, 0.3, 0.2))
SWEEP = SweepTrajectory(
    kind="sweep", name="one joint", period=20.0, corner=0.5, joints={"telescope": COURSE}
)


@pytest.fixture(scope="module")
def designed():
    return design_sweeps(MACHINE, PLANAR_JOINTS, CLEARANCE, MARGINS, [0.2, 0.8], 2.0, "designed")


def test_is_continuous_in_acceleration_and_consistent():
    time = np.linspace(-5.0, 30.0, 70_001)
    samples, step = SWEEP.evaluate(time), time[1] - time[0]
    for lower, upper in pairwise(samples):
        numeric = (lower[2:] - lower[:-2]) / (2 * step)
        np.testing.assert_allclose(upper[1:-1], numeric, atol=5e-3)
    assert np.abs(np.diff(samples.acceleration, axis=0)).max() < 0.02


def test_speed_is_exact_between_corners_and_positions_are_held_in_dwells():
    polygon = COURSE.time, COURSE.position
    middle = SWEEP.evaluate(np.array([1.5, 3.5, 4.5, 12.0, 32.0]))
    assert middle.velocity[:, 0] == pytest.approx([0.7 / 3, 0.0, -0.6, -0.1 / 15, -0.1 / 15])
    assert middle.position[:, 0] == pytest.approx(np.interp([1.5, 3.5, 4.5, 12, 12], *polygon))
    assert (middle.acceleration == 0.0).all()


def test_rounding_passes_no_position_and_no_speed():
    samples = SWEEP.evaluate(np.linspace(0.0, 20.0, 20_001))
    assert samples.position.max() <= 0.9 + 1e-12
    assert samples.position.min() >= 0.2 - 1e-12
    assert samples.velocity.max() <= 0.7 / 3 + 1e-12
    assert samples.velocity.min() >= -0.6 - 1e-12


def test_file_round_trip(tmp_path):
    save(tmp_path / "sweep.yaml", SWEEP)
    assert load_trajectory(tmp_path / "sweep.yaml") == SWEEP


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"time": [0, 1, 1, 20], "position": [0, 1, 1, 0]}, "increase"),
        ({"time": [0, 1, 20], "position": [0, 1, 2]}, "the last must be the first"),
        ({"time": [0, 1, 20], "position": [0, 1]}, "time has 3 entries and position 2"),
        ({"time": [0] * 501, "position": [0] * 501}, "must have at most 500 entries"),
        ({"time": [0, 1, 19], "position": [0, 1, 0]}, "must end with the period 20 s"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path, change, named):
    path = tmp_path / "wrong.yaml"
    path.write_text(
        f"{{kind: sweep, name: wrong, period: 20, corner: 0.5, joints: {{slew: {change}}}}}"
    )
    with pytest.raises(ConfigurationError, match=r"wrong\.yaml.*slew|wrong\.yaml") as caught:
        load_trajectory(path)
    assert named in str(caught.value)


def test_a_corner_as_sharp_as_no_crane_turns_is_refused(tmp_path):
    path = tmp_path / "sweep.yaml"
    save(path, SWEEP.model_copy(update={"corner": 1e-7}))
    with pytest.raises(ConfigurationError, match="'corner': must be at least 0.1"):
        load_trajectory(path)


def test_design_moves_one_joint_at_a_time_at_the_speeds_wanted(designed):
    motion = designed.evaluate(np.arange(0.0, designed.period, 0.02))
    moving = np.abs(motion.velocity) > 1e-9
    assert moving.sum(axis=1).max() == 1
    assert (~moving).all(axis=1).mean() > 0.05  # dwells
    for i, joint in enumerate(PLANAR_JOINTS):
        limits = MACHINE.limits[joint]
        top = 0.95 * min(limits.velocity_max, -limits.velocity_min)
        uniform = (motion.acceleration[:, i] == 0.0) & moving[:, i]
        speeds = motion.velocity[uniform, i]
        for speed in (0.2 * top, 0.8 * top):
            for way in (1, -1):
                assert (np.abs(speeds - way * speed) < 1e-5).sum() > 50, (joint, way * speed)
        half = 0.5 * (limits.position_max - limits.position_min)
        assert np.ptp(motion.position[:, i]) > half


def test_designed_sweeps_can_be_run(designed):
    assert trajectory_violations(MACHINE, designed, CLEARANCE) == []
    motion = plan(MACHINE, designed, np.array([0.0, 0.35, -1.5, 0.4]), 1, CLEARANCE)
    assert motion.excitation_end - motion.excitation_start == designed.period
    assert designed.corner == CORNER


def test_no_clearance_is_refused():
    high = Clearance(gripper_length=9.0, ground_clearance=0.0, pillar_clearance=0.0)
    with pytest.raises(RangeError, match="no pose within the joint limits"):
        design_sweeps(MACHINE, PLANAR_JOINTS, high, MARGINS, [0.5], 1.0, "none")
