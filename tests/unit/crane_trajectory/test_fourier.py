"""Fourier references against numeric differentiation, the FFT and the printed sum (32)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_model import ConfigurationError
from crane_model.configuration import load, save
from crane_trajectory import FourierTrajectory, load_trajectory
from crane_trajectory.motion.periodic import JointSeries

coefficient = st.floats(-1.0, 1.0, allow_subnormal=False)


@st.composite
def trajectories(draw):
    series = st.integers(1, 6).flatmap(
        lambda n: st.builds(
            JointSeries,
            offset=coefficient,
            sine=st.tuples(*[coefficient] * n),
            cosine=st.tuples(*[coefficient] * n),
        )
    )
    joints = draw(
        st.dictionaries(
            st.sampled_from(["telescope", "slew", "outer_boom", "inner_boom"]), series, min_size=1
        )
    )
    return FourierTrajectory(name="drawn", period=draw(st.floats(1.0, 100.0)), joints=joints)


@settings(max_examples=50, deadline=None)
@given(trajectories(), st.floats(-200.0, 200.0))
def test_is_the_sum_of_equation_32(trajectory, time):
    position = trajectory.evaluate(np.array([time])).position[0]
    omega = 2 * math.pi / trajectory.period
    for column, joint in enumerate(trajectory.joint_names):
        series = trajectory.joints[joint]
        total = series.offset
        for k, (a, b) in enumerate(zip(series.sine, series.cosine, strict=True), start=1):
            total += a * math.sin(k * omega * time) - b * math.cos(k * omega * time)
        assert position[column] == pytest.approx(total, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(trajectories())
def test_derivatives_match_numeric_differentiation(trajectory):
    time = np.linspace(0.0, trajectory.period, 50)
    step = 1e-4 * trajectory.period / trajectory.harmonics
    sampled = trajectory.evaluate(time)
    later, earlier = trajectory.evaluate(time + step), trajectory.evaluate(time - step)
    scale = 2 * np.pi * trajectory.harmonics / trajectory.period * 12
    for lower, upper in [("position", "velocity"), ("velocity", "acceleration")]:
        numeric = (getattr(later, lower) - getattr(earlier, lower)) / (2 * step)
        bound = 1e-6 * scale * (1.0 if upper == "velocity" else scale)
        np.testing.assert_allclose(getattr(sampled, upper), numeric, rtol=0, atol=bound)


@settings(max_examples=50, deadline=None)
@given(trajectories())
def test_fft_of_one_period_gives_the_coefficients_back(trajectory):
    n = 64
    position = trajectory.evaluate(np.arange(n) * trajectory.period / n).position
    spectrum = np.fft.rfft(position, axis=0) / n
    highest = trajectory.harmonics
    found = np.vstack(
        [
            spectrum[:1].real,
            -2 * spectrum[1 : highest + 1].imag,
            -2 * spectrum[1 : highest + 1].real,
        ]
    )
    np.testing.assert_allclose(found, trajectory.coefficients, atol=1e-12)


@given(trajectories())
@settings(max_examples=20, deadline=None)
def test_coefficients_round_trip(trajectory):
    again = FourierTrajectory.from_coefficients(
        "again", trajectory.period, trajectory.joint_names, trajectory.coefficients
    )
    assert again.joint_names == trajectory.joint_names
    np.testing.assert_array_equal(again.coefficients, trajectory.coefficients)


def test_file_round_trip(tmp_path):
    trajectory = FourierTrajectory(
        name="two joints",
        period=20.0,
        joints={
            "telescope": JointSeries(offset=0.7, sine=(0.1, 0.2), cosine=(0.0, -0.1)),
            "inner_boom": JointSeries(offset=0.4, sine=(0.1,), cosine=(0.3,)),
        },
        provenance="drawn by hand\nfor this test",
        figures_of_merit={"condition number": 12.5},
    )
    path = tmp_path / "trajectory.yaml"
    save(path, trajectory)
    assert load(path, FourierTrajectory) == trajectory
    assert load_trajectory(path).joint_names == ("telescope", "inner_boom")


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("period: -20", "period"),
        ("period: .nan", "period"),
        ("period: 1e-9", "'period': must be at least 1.0 (got"),
        ("period: 4000", "'period': must be at most 3600.0 (got"),
        (
            f"joints: {{slew: {{offset: 0, sine: {[0] * 51}, cosine: {[0] * 51}}}}}",
            "joints.slew.sine': must have at most 50 entries",
        ),
        ("joints: {slew: {offset: 0, sine: [1, 2], cosine: [0]}}", "2 coefficients and cosine 1"),
        ("joints: {slew: {offset: 0, sine: [], cosine: []}}", "joints.slew.sine"),
        ("joints: {}", "joints"),
        ("amplitude: 3", "amplitude"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path, line, named):
    content = {
        "name": "name: wrong",
        "period": "period: 20",
        "joints": "joints: {slew: {offset: 0, sine: [1], cosine: [0]}}",
    }
    content[line.split(":")[0]] = line
    path = tmp_path / "wrong.yaml"
    path.write_text("\n".join(content.values()))
    with pytest.raises(ConfigurationError, match="wrong.yaml") as caught:
        load_trajectory(path)
    assert named in str(caught.value)
