"""Approach, periods and stop as one motion: continuity, limits, phases."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.event import install_recorder

from crane_benchmark.cases.motions import Stretch
from crane_model import RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_trajectory import FourierTrajectory, Motion, SweepTrajectory, load_clearance, plan
from crane_trajectory.motion.motion import (
    APPROACH_SHARE,
    RUN_UP,
    Phase,
    ReferenceClock,
    compile_reference,
)
from crane_trajectory.motion.periodic import JointCourse, JointSeries

MACHINE = load_machine()
JOINTS = MACHINE.joint_names
CLEARANCE = load_clearance(machine_file("clearance.yaml"))
TRAJECTORY = FourierTrajectory(
    name="two harmonics",
    period=20.0,
    joints={
        "inner_boom": JointSeries(offset=0.6, sine=(0.2, 0.05), cosine=(0.1, -0.04)),
        "outer_boom": JointSeries(offset=-0.9, sine=(-0.1, 0.2), cosine=(0.3, 0.0)),
        "telescope": JointSeries(offset=0.5, sine=(0.2, -0.1), cosine=(-0.1, 0.1)),
    },
)
START = np.array([0.7, 0.35, -0.9, 0.4])


def test_visits_every_phase_in_order_and_rests_at_both_ends():
    motion = plan(MACHINE, TRAJECTORY, START, 3, CLEARANCE)
    time = np.linspace(-1.0, motion.duration + 1.0, 20_001)
    reference = motion.reference(time)
    changes = np.flatnonzero(np.diff(reference.phase))
    assert reference.phase[np.append(changes, -1)].tolist() == [
        Phase.REST,
        Phase.APPROACH,
        Phase.EXCITATION,
        Phase.STOP,
        Phase.REST,
    ]
    np.testing.assert_allclose(
        time[changes],
        [0.0, motion.excitation_start, motion.excitation_end, motion.duration],
        atol=time[1] - time[0],
    )
    assert motion.excitation_end - motion.excitation_start == pytest.approx(60.0)
    resting = reference.phase == Phase.REST
    assert np.abs(reference.velocity[resting]).max() == 0.0
    assert np.abs(reference.acceleration[resting]).max() == 0.0
    np.testing.assert_array_equal(reference.position[0], START)
    np.testing.assert_allclose(np.ptp(reference.position[time > motion.duration], axis=0), 0.0)


def test_the_periods_are_the_trajectory_and_the_slew_is_held():
    motion = plan(MACHINE, TRAJECTORY, START, 2, CLEARANCE)
    times = np.linspace(0.0, 2 * TRAJECTORY.period, 500)
    reference = motion.reference(motion.excitation_start + times)
    expected = TRAJECTORY.evaluate(times)
    np.testing.assert_allclose(reference.position[:, 1:], expected.position, atol=1e-12)
    np.testing.assert_allclose(reference.velocity[:, 1:], expected.velocity, atol=1e-12)
    np.testing.assert_allclose(reference.acceleration[:, 1:], expected.acceleration, atol=1e-12)
    assert (reference.position[:, 0] == START[0]).all()
    assert (reference.velocity[:, 0] == 0.0).all()


def test_position_velocity_and_acceleration_are_continuous_and_consistent():
    motion = plan(MACHINE, TRAJECTORY, START, 1, CLEARANCE)
    step = 1e-3
    time = np.arange(-0.5, motion.duration + 0.5, step)
    reference = motion.reference(time)
    for lower, upper in (
        (reference.position, reference.velocity),
        (reference.velocity, reference.acceleration),
    ):
        numeric = (lower[2:] - lower[:-2]) / (2 * step)
        np.testing.assert_allclose(upper[1:-1], numeric, atol=2e-3 * np.abs(upper).max())
    jerk = np.diff(reference.acceleration, axis=0) / step
    assert np.abs(jerk).max() < 1.0  # a jump of 0.001 rad/s2 between samples would pass it


poses = st.tuples(
    st.floats(-1.9, 1.9), st.floats(0.4, 1.2), st.floats(-1.0, -0.3), st.floats(0.05, 1.2)
)


@settings(max_examples=8, deadline=None)
@given(poses)
def test_limits_hold_from_anywhere_clear_of_ground_and_pillar(start):
    motion = plan(MACHINE, TRAJECTORY, np.array(start), 1, CLEARANCE)
    reference = motion.reference(np.linspace(0.0, motion.duration, 5000))
    for i, joint in enumerate(JOINTS):
        limits = MACHINE.limits[joint]
        assert reference.position[:, i].min() >= limits.position_min
        assert reference.position[:, i].max() <= limits.position_max
        assert reference.velocity[:, i].min() >= limits.velocity_min
        assert reference.velocity[:, i].max() <= limits.velocity_max


def test_the_approach_uses_its_share_of_the_tightest_limit():
    motion = plan(MACHINE, TRAJECTORY, START + [0.0, 0.6, 0.0, 0.0], 1, CLEARANCE)
    time = np.linspace(0.0, motion.approach_time, 2001)[:-1]
    velocity = motion.reference(time).velocity
    assert velocity[:, 1].min() == pytest.approx(
        APPROACH_SHARE * MACHINE.limits["inner_boom"].velocity_min, rel=1e-3
    )


def test_start_and_stop_stay_on_the_path_of_the_trajectory():
    motion = plan(MACHINE, TRAJECTORY, START, 1, CLEARANCE)
    path = TRAJECTORY.evaluate(np.linspace(-RUN_UP, TRAJECTORY.period, 20_000)).position
    for begin in (motion.approach_time, motion.excitation_end):
        time = np.linspace(begin, begin + RUN_UP, 50)
        for position in motion.reference(time).position[:, 1:]:
            assert np.linalg.norm(path - position, axis=1).min() < 1e-3


@pytest.mark.parametrize(
    ("start", "periods", "named"),
    [
        ([0.0, 1.5, -0.9, 0.4], 1, "inner_boom: position 1.5 rad at t = 0.000 s is above"),
        ([0.0, 0.3, np.nan, 0.4], 1, "one finite position for each of slew"),
        ([0.0, 0.3, -0.9], 1, "one finite position for each of slew"),
        ([0.0, 0.3, -0.9, 0.4], 0, "periods: at least 1, got 0"),
        ([0.0, -0.3, -1.3, 1.0], 1, "boom tip: height"),
    ],
)
def test_what_cannot_be_run_is_refused(start, periods, named):
    with pytest.raises(RangeError) as caught:
        plan(MACHINE, TRAJECTORY, np.array(start), periods, CLEARANCE)
    assert named in str(caught.value)


def test_a_trajectory_beyond_the_limits_is_refused_with_all_its_violations():
    series = JointSeries(offset=0.45, sine=(0.8,), cosine=(0.0,))
    joints = {**TRAJECTORY.joints, "inner_boom": series}
    trajectory = FourierTrajectory(name="too fast", period=20.0, joints=joints)
    with pytest.raises(RangeError) as caught:
        plan(MACHINE, trajectory, START, 1, CLEARANCE)
    text = str(caught.value)
    assert "inner_boom: velocity" in text
    assert text.count("inner_boom: velocity") == 2
    assert "too fast" in text


@pytest.mark.parametrize("offset", [1e9, -1e300])
def test_a_start_that_is_out_of_reach_is_refused_and_takes_no_memory(offset):
    series = JointSeries(offset=offset, sine=(0.1,), cosine=(0.0,))
    trajectory = FourierTrajectory(name="far", period=20.0, joints={"telescope": series})
    with pytest.raises(RangeError, match=r"'far' from .* at most 600 s are allowed"):
        plan(MACHINE, trajectory, START, 1, CLEARANCE)


def test_an_experiment_without_end_is_refused():
    with pytest.raises(RangeError, match=r"periods: 4294967295 of 20 s would .* at most 24 h"):
        plan(MACHINE, TRAJECTORY, START, 2**32 - 1, CLEARANCE)


def test_a_motion_of_many_periods_is_checked_as_fast_as_one():
    motion = Motion(MACHINE, TRAJECTORY, START, 10_000, approach_time=5.0)
    assert motion.violations(CLEARANCE) == []


SWEEP = SweepTrajectory(
    kind="sweep",
    name="two joints",
    period=20.0,
    corner=1.5,
    joints={
        "slew": JointCourse(time=(0.0, 1.0, 1.1, 1.4, 20.0), position=(0.7, 0.9, 0.6, 0.9, 0.7)),
        "telescope": JointCourse(time=(0.0, 3.0, 4.0, 20.0), position=(0.2, 0.9, 0.9, 0.2)),
    },
)


@pytest.mark.parametrize("trajectory", [TRAJECTORY, SWEEP, Stretch(TRAJECTORY, period=14.0)])
def test_the_reference_of_one_instant_is_that_of_an_array_of_times(trajectory):
    motion = Motion(MACHINE, trajectory, START, 2, approach_time=3.1)
    changes = 0.0, 3.1, motion.excitation_start, motion.excitation_end, motion.duration, 1e3
    times = np.append(np.linspace(-1.0, motion.duration + 1.0, 3001), changes)
    reference = motion.reference(times)
    points = np.array([motion.at(time) for time in times])
    np.testing.assert_allclose(points, np.stack(reference[:3], axis=1), rtol=0.0, atol=1e-12)
    assert [motion.phase(time) for time in times] == reference.phase.tolist()


def test_nothing_is_compiled_while_the_crane_moves():
    compile_reference(MACHINE)
    with install_recorder("numba:compile") as recorder:
        for trajectory in (TRAJECTORY, SWEEP):
            motion, clock = Motion(MACHINE, trajectory, START, 1, 5.0), ReferenceClock(0.0)
            for time in np.arange(0.0, motion.duration + 1.0, 0.04):
                clock.advance(0.04)
                clock.target(motion)
                if time > motion.excitation_start + 5.0:
                    clock.brake()
    assert not recorder.buffer
