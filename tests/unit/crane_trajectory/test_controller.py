"""Properties of the controller (36), and its behaviour on a valve with a dead zone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import JOINTS
from crane_trajectory.control.controller import JointGains, command, joint_command, load_gains

GAINS = load_gains().table
number = st.floats(-10.0, 10.0)
slow = st.floats(-0.03, 0.03)
column = st.integers(0, 3)


def uniform(gains, q, velocity, q_ref, velocity_ref):
    """`joint_command` of all samples, for arrays of any length."""
    return np.array(
        [joint_command(gains, *s) for s in np.broadcast(q, velocity, q_ref, velocity_ref)]
    )


@settings(deadline=None)
@given(st.lists(st.tuples(number, number, number, number), min_size=4, max_size=4))
def test_bounded(samples):
    u = command(GAINS, *np.array(samples).T)
    assert u.shape == (4,)
    assert np.abs(u).max() <= 1.0


@settings(deadline=None)
@given(column, number, slow, slow, st.floats(0.0, 1.0))
def test_does_not_rise_with_the_position_error(joint, q, velocity, velocity_ref, rise):
    lower, higher = uniform(GAINS[joint], [q, q + rise], velocity, 0.0, velocity_ref)
    assert higher <= lower


@settings(deadline=None)
@given(column, slow, slow, slow, st.floats(0.0, 1.0))
def test_does_not_fall_with_the_reference_velocity(joint, error, velocity, velocity_ref, rise):
    lower, higher = uniform(GAINS[joint], error, velocity, 0.0, [velocity_ref, velocity_ref + rise])
    assert higher >= lower


@settings(max_examples=200, deadline=None)
@given(column, slow, slow, slow)
def test_continuous(joint, error, velocity, velocity_ref):
    step = 1e-9
    kp, kd, up, down, standstill, tolerance = GAINS[joint]
    steepest = kp + kd + 4 * max(up, down) * (1 / standstill + 1 / tolerance)
    here = joint_command(GAINS[joint], error, velocity, 0.0, velocity_ref)
    near = [
        joint_command(GAINS[joint], error + step, velocity, 0.0, velocity_ref),
        joint_command(GAINS[joint], error, velocity + step, 0.0, velocity_ref),
        joint_command(GAINS[joint], error, velocity, 0.0, velocity_ref + step),
    ]
    assert np.abs(np.array(near) - here).max() <= steepest * step


@pytest.mark.parametrize("joint", range(4))
def test_continuous_across_standstill_and_its_band(joint):
    standstill = GAINS[joint][4]
    velocity = np.linspace(-2 * standstill, 2 * standstill, 4001)
    u = uniform(GAINS[joint], 0.0, velocity, 0.0, 0.0)
    assert np.abs(np.diff(u)).max() < 0.002 * GAINS[joint][2:4].max() + 1e-4


@settings(deadline=None)
@given(column, st.floats(-1.0, 1.0))
def test_at_rest_within_tolerance_the_valve_stays_closed(joint, share):
    kp, _, up, down, _, tolerance = GAINS[joint]
    u = joint_command(GAINS[joint], share * tolerance, 0.0, 0.0, 0.0)
    assert u == pytest.approx(-kp * share * tolerance)
    assert -down <= u <= up
    assert joint_command(GAINS[joint], 0.0, 0.0, 0.0, 0.0) == 0.0


@settings(deadline=None)
@given(column, st.floats(2.0, 5.0), st.sampled_from([-1.0, 1.0]))
def test_at_rest_beyond_twice_the_tolerance_the_dead_zone_is_crossed(joint, times, sign):
    _, _, up, down, _, tolerance = GAINS[joint]
    u = joint_command(GAINS[joint], -sign * times * tolerance, 0.0, 0.0, 0.0)
    assert sign * u > (up if sign > 0 else down)


@settings(deadline=None)
@given(column, st.floats(1.0, 5.0), st.sampled_from([-1.0, 1.0]), slow)
def test_outside_the_standstill_band_compensation_has_the_sign_of_the_motion(
    joint, times, sign, error
):
    kp, kd, up, down, standstill, _ = GAINS[joint]
    velocity = sign * times * standstill
    u = joint_command(GAINS[joint], error, velocity, 0.0, 0.0)
    plain = -kp * error - kd * velocity + (up if sign > 0 else -down)
    assert u == pytest.approx(np.clip(plain, -1, 1))


def test_without_compensation_it_is_pd():
    gains = GAINS.copy()
    gains[:, 2:4] = 0.0
    rng = np.random.default_rng(0)
    for _ in range(100):
        q, velocity, q_ref, velocity_ref = rng.normal(0.0, 0.1, (4, 4))
        plain = -gains[:, 0] * (q - q_ref) - gains[:, 1] * (velocity - velocity_ref)
        np.testing.assert_allclose(
            command(gains, q, velocity, q_ref, velocity_ref), np.clip(plain, -1, 1)
        )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("joint", range(4))
def test_a_command_is_never_made_of_inputs_that_are_not_finite(bad, kind, joint):
    inputs = np.zeros((4, 4))
    inputs[kind, joint] = bad
    with pytest.raises(RangeError, match=f"{JOINTS[joint]}: .*{bad}"):
        command(GAINS, *inputs)
    assert np.isnan(joint_command(GAINS[joint], *inputs[:, joint]))


def test_gains_that_open_the_valve_at_rest_are_refused(tmp_path):
    text = "{kp: 20, kd: 0, dead_zone_positive: 0.06, dead_zone_negative: 0.02, "
    text += "standstill_speed: 0.01, position_tolerance: 0.002}"
    path = tmp_path / "gains.yaml"
    path.write_text("".join(f"{joint}: {text}\n" for joint in JOINTS))
    with pytest.raises(ConfigurationError, match="kp times position_tolerance is 0.04"):
        load_gains(path)


def test_the_table_is_in_the_order_that_the_compiled_law_reads():
    assert list(JointGains.model_fields) == [
        "kp",
        "kd",
        "dead_zone_positive",
        "dead_zone_negative",
        "standstill_speed",
        "position_tolerance",
    ]
    inner_boom = load_gains().inner_boom
    assert load_gains().table[1].tolist() == list(inner_boom.model_dump().values())


@pytest.mark.parametrize("joint", range(4))
def test_follows_a_sine_and_then_holds_still_behind_a_dead_zone(joint):
    """A velocity source behind a dead zone and a lag: tracks, comes to rest, opens no valve."""
    dead_zone, top_speed, lag, step = GAINS[joint][2], 0.6, 0.02, 0.005
    q, velocity, spool = 0.05, 0.0, 0.0
    errors, commands = [], []
    for i in range(12_000):
        time = i * step
        moving = time < 40.0
        q_ref = 0.2 * (1 - np.cos(0.2 * np.pi * time)) if moving else 0.0
        velocity_ref = 0.04 * np.pi * np.sin(0.2 * np.pi * time) if moving else 0.0
        u = joint_command(GAINS[joint], q, velocity, q_ref, velocity_ref)
        spool += (u - spool) * step / lag
        velocity = top_speed * np.sign(spool) * max(abs(spool) - dead_zone, 0.0)
        q += velocity * step
        errors.append(q - q_ref)
        commands.append(u)
    lag = 0.04 * np.pi / (top_speed * GAINS[joint][0])  # of proportional control at this speed
    assert np.abs(errors[1000:8000]).max() < 1.5 * lag
    assert np.abs(errors[-2000:]).max() < 3 * GAINS[joint][5]
    assert np.ptp(commands[-2000:]) < 1e-6  # no buzzing
    assert abs(velocity) < 1e-12
