"""The whole-trajectory check against closed forms, polynomial roots and dense sampling."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_model.changed_machine import with_actuator

from crane_model import RangeError, load_machine
from crane_model.cylinders import cylinder_length
from crane_model.machine_files import machine_file
from crane_trajectory import Clearance, FourierTrajectory, load_clearance
from crane_trajectory.motion.check import (
    TipClearance,
    maxima,
    pump_flow,
    refuse,
    trajectory_violations,
)
from crane_trajectory.motion.periodic import JointSeries

MACHINE = load_machine()
PLANAR_JOINTS = MACHINE.joint_names[1:]
CLEARANCE = load_clearance(machine_file("clearance.yaml"))


def sine(joint, offset, amplitude, period=20.0, harmonic=1):
    waves = (0.0,) * (harmonic - 1) + (amplitude,)
    series = JointSeries(offset=offset, sine=waves, cosine=(0.0,) * harmonic)
    return FourierTrajectory(name="sine", period=period, joints={joint: series})


def planar(outer_boom=-1.2, inner_boom=0.4, telescope=0.7, amplitude=0.05, period=20.0):
    return FourierTrajectory(
        name="planar",
        period=period,
        joints={
            joint: JointSeries(offset=offset, sine=(amplitude,), cosine=(0.0,))
            for joint, offset in zip(
                PLANAR_JOINTS, (inner_boom, outer_boom, telescope), strict=True
            )
        },
    )


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(-1000, 1000), min_size=10, max_size=10))
def test_extremes_of_a_trigonometric_polynomial_are_those_of_its_roots(coefficients):
    a, b = np.array(coefficients).reshape(2, 5) / 1000.0
    a[4] += 2.0  # a highest harmonic, and so ten roots
    k = np.arange(1, 6)

    def value(angle):
        return np.sin(np.outer(angle, k)) @ a - np.cos(np.outer(angle, k)) @ b

    # derivative: sum k (a cos + b sin) = z^-5 times a polynomial in z = exp(i angle)
    half = k * (a - 1j * b) / 2
    polynomial = np.concatenate([half[::-1], [0], half.conj()])
    stationary = np.angle(np.roots(polynomial))
    angles, found = maxima(
        lambda t: np.stack([value(t), -value(t)], axis=1), np.linspace(0, 2 * np.pi, 201)
    )
    for sign, angle, largest in zip((1, -1), angles, found, strict=True):
        exact = (sign * value(stationary)).max()
        assert largest == pytest.approx(exact, abs=1e-9)
        assert sign * value(np.array([angle]))[0] == pytest.approx(largest, abs=1e-12)


def test_maxima_at_the_ends_of_the_span_and_of_a_constant():
    grid = np.linspace(0.0, 1.0, 11)
    times, values = maxima(lambda t: np.stack([t, -t, 0 * t + 3.0], axis=1), grid)
    assert times[:2].tolist() == [1.0, 0.0]
    assert values.tolist() == [1.0, 0.0, 3.0]


def test_a_trajectory_within_the_limits_passes():
    assert trajectory_violations(MACHINE, planar(), CLEARANCE) == []
    refuse([], "planar", "none is needed")


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
@pytest.mark.parametrize("side", ["above", "below"])
def test_position_violation_names_joint_time_limit_and_value(joint, side):
    limits = MACHINE.limits[joint]
    middle = (limits.position_min + limits.position_max) / 2
    amplitude = (limits.position_max - limits.position_min) / 2 + 0.001
    found = trajectory_violations(MACHINE, sine(joint, middle, amplitude, period=200.0), CLEARANCE)
    positions = [violation for violation in found if violation.quantity == "position"]
    assert [(v.joint, v.limit) for v in positions] == [
        (joint, limits.position_max),
        (joint, limits.position_min),
    ]
    violation = positions[0 if side == "above" else 1]
    sign = 1 if side == "above" else -1
    assert violation.value == pytest.approx(middle + sign * amplitude, rel=1e-12)
    assert violation.time == pytest.approx(50.0 if side == "above" else 150.0, abs=1e-3)
    assert side in str(violation)


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_velocity_limit_is_exact(joint):
    limits = MACHINE.limits[joint]
    middle = (limits.position_min + limits.position_max) / 2
    slowest = min(limits.velocity_max, -limits.velocity_min)
    period, harmonic = 7.0, 3
    amplitude = slowest / (2 * math.pi * harmonic / period)
    at_limit = sine(joint, middle, amplitude, period, harmonic)
    beyond = sine(joint, middle, amplitude * (1 + 1e-6), period, harmonic)
    assert trajectory_violations(MACHINE, at_limit, CLEARANCE) == []
    (violation,) = trajectory_violations(MACHINE, beyond, CLEARANCE)
    assert (violation.joint, violation.quantity) == (joint, "velocity")
    assert abs(violation.value) == pytest.approx(slowest * (1 + 1e-6), rel=1e-12)
    rate = 2 * math.pi * harmonic / period
    assert abs(math.cos(rate * violation.time)) == pytest.approx(1.0, abs=1e-6)


def test_stroke_of_a_shorter_cylinder():
    limits = MACHINE.limits["outer_boom"]
    trajectory = sine("outer_boom", -1.4, 0.3)
    lengths = cylinder_length(MACHINE, "outer_boom", np.array([-1.7, -1.1]))
    longest, at = lengths.max(), (-1.7, -1.1)[lengths.argmax()]
    assert limits.position_min < at < limits.position_max
    machine = with_actuator(MACHINE, "outer_boom", length_max=longest - 1e-3)
    (violation,) = trajectory_violations(machine, trajectory, CLEARANCE)
    assert (violation.joint, violation.quantity) == ("outer_boom", "cylinder length")
    assert violation.limit == longest - 1e-3
    assert violation.value == pytest.approx(longest, rel=1e-12)
    assert trajectory.evaluate(np.array([violation.time])).position == pytest.approx(at, abs=1e-9)


def test_a_linkage_that_cannot_be_assembled_is_named():
    machine = with_actuator(MACHINE, "outer_boom", c1=0.14, c2=0.14)
    found = trajectory_violations(machine, sine("outer_boom", -1.4, 2.0, period=60.0), CLEARANCE)
    text = "\n".join(map(str, found))
    assert "outer_boom: the linkage cannot be assembled" in text
    assert "outer_boom: position 0.6 rad" in text


def test_pump_flow_is_area_of_the_filling_chamber_times_speed():
    trajectory = sine("telescope", 0.7, 0.5, period=10.0)
    time = np.linspace(0.0, 10.0, 1001)
    position, velocity, _ = trajectory.evaluate(time)
    flow = pump_flow(MACHINE, ("telescope",), position, velocity)
    telescope = MACHINE.cylinders["telescope"]
    area = np.where(velocity[:, 0] > 0, telescope.area_a, telescope.area_b)
    np.testing.assert_allclose(flow, area * np.abs(velocity[:, 0]))


def test_pump_flow_adds_up_over_cylinders_by_numeric_differentiation():
    trajectory = planar(amplitude=0.2)
    time, step = np.linspace(0.0, 20.0, 400), 1e-5
    position, velocity, _ = trajectory.evaluate(time)
    flow = pump_flow(MACHINE, PLANAR_JOINTS, position, velocity)
    expected = np.zeros_like(flow)
    for i, joint in enumerate(PLANAR_JOINTS):
        ahead, behind = (
            cylinder_length(MACHINE, joint, trajectory.evaluate(time + sign * step).position[:, i])
            for sign in (1, -1)
        )
        speed = (ahead - behind) / (2 * step)
        cylinder = MACHINE.cylinders[joint]
        expected += np.maximum(cylinder.area_a * speed, -cylinder.area_b * speed)
    np.testing.assert_allclose(flow, expected, atol=1e-10)


def test_pump_flow_violation_is_the_largest_of_a_dense_sampling():
    trajectory = planar(amplitude=0.2, inner_boom=0.3)
    weak = MACHINE.hydraulics.model_copy(update={"pump_flow": 1e-5})
    machine = MACHINE.model_copy(update={"supply": weak})
    no_room = Clearance(gripper_length=0.0, ground_clearance=0.0, pillar_clearance=0.0)
    (violation,) = trajectory_violations(machine, trajectory, no_room)
    position, velocity, _ = trajectory.evaluate(np.linspace(0, 20, 200_001))
    dense = pump_flow(MACHINE, PLANAR_JOINTS, position, velocity)
    assert (violation.joint, violation.quantity) == ("all cylinders", "pump flow")
    assert violation.value == pytest.approx(dense.max(), rel=1e-8)
    assert violation.value >= dense.max()


def test_tip_keeps_off_ground_and_pillar():
    low = trajectory_violations(MACHINE, planar(inner_boom=0.0, outer_boom=-1.5), CLEARANCE)
    assert [(v.joint, v.quantity, v.limit) for v in low] == [("boom tip", "height", 0.7)]
    near = trajectory_violations(MACHINE, planar(inner_boom=0.9, outer_boom=-2.6), CLEARANCE)
    assert ("boom tip", "distance from pillar") in [(v.joint, v.quantity) for v in near]


def test_tip_clearance_in_a_stretched_pose():
    # psi = 0: the telescope is level, at the elbow's height plus its offset
    dh = MACHINE.as_planar()
    q = np.array([[0.5, -0.5, 0.3]])
    phi = 0.5 + dh.theta_2_0
    expected = [
        dh.inner_boom_length * math.cos(phi) + dh.telescope_length + 0.3,
        dh.base_height + dh.inner_boom_length * math.sin(phi) + dh.telescope_offset,
    ]
    np.testing.assert_allclose(TipClearance(MACHINE).at(PLANAR_JOINTS, q)[0], expected, atol=1e-12)


def test_clearance_is_not_checked_without_all_planar_joints():
    clearance = Clearance(gripper_length=50.0, ground_clearance=0.0, pillar_clearance=50.0)
    assert trajectory_violations(MACHINE, sine("inner_boom", 0.4, 0.1), clearance) == []
    assert len(trajectory_violations(MACHINE, planar(), clearance)) == 2


def test_refusal_lists_everything():
    trajectory = sine("inner_boom", 0.4, 2.0)
    with pytest.raises(RangeError) as caught:
        found = trajectory_violations(MACHINE, trajectory, CLEARANCE)
        refuse(found, "trajectory 'sine'", "lower the amplitude")
    text = str(caught.value)
    assert text.startswith("trajectory 'sine'")
    for part in (
        "lower the amplitude",
        "inner_boom: position 2.4 rad",
        "limit 1.37 rad",
        "velocity",
        "limit -0.16 rad/s",
    ):
        assert part in text
