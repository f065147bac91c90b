"""Properties of the controller (36), and its behaviour on a valve with a dead band."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_model import ConfigurationError, RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_trajectory.control.controller import (
    GainFields,
    JointGains,
    command,
    joint_command,
    load_gains,
)

JOINTS = load_machine().joint_names
GAINS = load_gains(machine_file("controller.yaml"), load_machine()).arrays
UNITS = load_machine().units
ROWS = [GainFields(*row) for row in zip(*GAINS, strict=True)]
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
    u = command(GAINS, *np.array(samples).T, UNITS)
    assert u.shape == (4,)
    assert np.abs(u).max() <= 1.0


@settings(deadline=None)
@given(column, number, slow, slow, st.floats(0.0, 1.0))
def test_does_not_rise_with_the_position_error(joint, q, velocity, velocity_ref, rise):
    lower, higher = uniform(ROWS[joint], [q, q + rise], velocity, 0.0, velocity_ref)
    assert higher <= lower


@settings(deadline=None)
@given(column, slow, slow, slow, st.floats(0.0, 1.0))
def test_does_not_fall_with_the_reference_velocity(joint, error, velocity, velocity_ref, rise):
    lower, higher = uniform(ROWS[joint], error, velocity, 0.0, [velocity_ref, velocity_ref + rise])
    assert higher >= lower


@settings(max_examples=200, deadline=None)
@given(column, slow, slow, slow)
def test_continuous(joint, error, velocity, velocity_ref):
    step = 1e-9
    kp, kd, up, down, standstill, tolerance = ROWS[joint]
    steepest = kp + kd + 4 * max(up, down) * (1 / standstill + 1 / tolerance)
    here = joint_command(ROWS[joint], error, velocity, 0.0, velocity_ref)
    near = [
        joint_command(ROWS[joint], error + step, velocity, 0.0, velocity_ref),
        joint_command(ROWS[joint], error, velocity + step, 0.0, velocity_ref),
        joint_command(ROWS[joint], error, velocity, 0.0, velocity_ref + step),
    ]
    assert np.abs(np.array(near) - here).max() <= steepest * step


@pytest.mark.parametrize("joint", range(4))
def test_continuous_across_standstill_and_its_band(joint):
    standstill = GAINS.standstill_speed[joint]
    velocity = np.linspace(-2 * standstill, 2 * standstill, 4001)
    u = uniform(ROWS[joint], 0.0, velocity, 0.0, 0.0)
    widest = max(GAINS.dead_band_positive[joint], GAINS.dead_band_negative[joint])
    assert np.abs(np.diff(u)).max() < 0.002 * widest + 1e-4


@settings(deadline=None)
@given(column, st.floats(-1.0, 1.0))
def test_at_rest_within_tolerance_the_valve_stays_closed(joint, share):
    kp, _, up, down, _, tolerance = ROWS[joint]
    u = joint_command(ROWS[joint], share * tolerance, 0.0, 0.0, 0.0)
    assert u == pytest.approx(-kp * share * tolerance)
    assert -down <= u <= up
    assert joint_command(ROWS[joint], 0.0, 0.0, 0.0, 0.0) == 0.0


@settings(deadline=None)
@given(column, st.floats(2.0, 5.0), st.sampled_from([-1.0, 1.0]))
def test_at_rest_beyond_twice_the_tolerance_the_dead_band_is_crossed(joint, times, sign):
    _, _, up, down, _, tolerance = ROWS[joint]
    u = joint_command(ROWS[joint], -sign * times * tolerance, 0.0, 0.0, 0.0)
    assert sign * u > (up if sign > 0 else down)


@settings(deadline=None)
@given(column, st.floats(1.0, 5.0), st.sampled_from([-1.0, 1.0]), slow)
def test_outside_the_standstill_band_compensation_has_the_sign_of_the_motion(
    joint, times, sign, error
):
    kp, kd, up, down, standstill, _ = ROWS[joint]
    velocity = sign * times * standstill
    u = joint_command(ROWS[joint], error, velocity, 0.0, 0.0)
    plain = -kp * error - kd * velocity + (up if sign > 0 else -down)
    assert u == pytest.approx(np.clip(plain, -1, 1))


def test_without_compensation_it_is_pd():
    gains = GAINS._replace(dead_band_positive=np.zeros(4), dead_band_negative=np.zeros(4))
    rng = np.random.default_rng(0)
    for _ in range(100):
        q, velocity, q_ref, velocity_ref = rng.normal(0.0, 0.1, (4, 4))
        plain = -gains.kp * (q - q_ref) - gains.kd * (velocity - velocity_ref)
        np.testing.assert_allclose(
            command(gains, q, velocity, q_ref, velocity_ref, UNITS), np.clip(plain, -1, 1)
        )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("joint", range(4))
def test_a_command_is_never_made_of_inputs_that_are_not_finite(bad, kind, joint):
    inputs = np.zeros((4, 4))
    inputs[kind, joint] = bad
    with pytest.raises(RangeError, match=f"{JOINTS[joint]}: .*{bad}"):
        command(GAINS, *inputs, UNITS)
    assert np.isnan(joint_command(ROWS[joint], *inputs[:, joint]))


def test_gains_that_open_the_valve_at_rest_are_refused(tmp_path):
    text = "{kp: 20, kd: 0, dead_band_positive: 0.06, dead_band_negative: 0.02, "
    text += "standstill_speed: 0.01, position_tolerance: 0.002}"
    path = tmp_path / "gains.yaml"
    path.write_text("".join(f"{joint}: {text}\n" for joint in JOINTS))
    with pytest.raises(ConfigurationError, match="kp times position_tolerance is 0.04"):
        load_gains(path, load_machine())


def test_every_gain_is_found_by_its_name(tmp_path):
    """Whatever the order of fields is: each of the four joints and six gains has a number."""
    names = list(JointGains.model_fields)
    assert set(GainFields._fields) == set(names)
    written = {
        joint: {name: 0.01 + 0.001 * (6 * i + k) for k, name in enumerate(names)}
        for i, joint in enumerate(JOINTS)
    }
    path = tmp_path / "gains.yaml"
    path.write_text(json.dumps(written))
    gains = load_gains(path, load_machine()).arrays
    for i, joint in enumerate(JOINTS):
        found = {name: values[i] for name, values in gains._asdict().items()}
        assert found == written[joint]


def test_the_law_reads_gains_by_name():
    """With one gain changed at a time, the command of (36) changes by that gain's own part."""
    row = ROWS[1]
    moving = 2.0 * row.standstill_speed
    parts = {
        "kp": ((0.01, moving, 0.0, moving), -0.01),
        "kd": ((0.0, moving, 0.0, moving - 0.01), -0.01),
        "dead_band_positive": ((0.0, moving, 0.0, moving), 1.0),
        "dead_band_negative": ((0.0, -moving, 0.0, -moving), -1.0),
    }
    for name, (inputs, slope) in parts.items():
        more = row._replace(**{name: getattr(row, name) + 0.01})
        change = joint_command(more, *inputs) - joint_command(row, *inputs)
        assert change == pytest.approx(0.01 * slope, rel=1e-9)


@pytest.mark.parametrize("joint", range(4))
def test_follows_a_sine_and_then_holds_still_behind_a_dead_band(joint):
    """A velocity source behind a dead band and a lag: tracks, comes to rest, opens no valve."""
    dead_band, top_speed, lag, step = GAINS.dead_band_positive[joint], 0.6, 0.02, 0.005
    q, velocity, spool = 0.05, 0.0, 0.0
    errors, commands = [], []
    for i in range(12_000):
        time = i * step
        moving = time < 40.0
        q_ref = 0.2 * (1 - np.cos(0.2 * np.pi * time)) if moving else 0.0
        velocity_ref = 0.04 * np.pi * np.sin(0.2 * np.pi * time) if moving else 0.0
        u = joint_command(ROWS[joint], q, velocity, q_ref, velocity_ref)
        spool += (u - spool) * step / lag
        velocity = top_speed * np.sign(spool) * max(abs(spool) - dead_band, 0.0)
        q += velocity * step
        errors.append(q - q_ref)
        commands.append(u)
    lag = 0.04 * np.pi / (top_speed * GAINS.kp[joint])  # of proportional control at this speed
    assert np.abs(errors[1000:8000]).max() < 1.5 * lag
    assert np.abs(errors[-2000:]).max() < 3 * GAINS.position_tolerance[joint]
    assert np.ptp(commands[-2000:]) < 1e-6  # no buzzing
    assert abs(velocity) < 1e-12
