"""What is computed in a bring-up, from synthetic records of machines that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import TransferFunction, lsim

from crane_driver.operator.bringup.estimates import (
    ENCODER_TURN_RAD,
    Nudge,
    Rest,
    StepFit,
    Trace,
    at_rest,
    average,
    find_encoder,
    find_offset,
    find_polarity,
    first_gains,
    fit_dead_band,
    fit_step,
    moved,
)
from crane_model import DataError

RESOLUTION = 4.8e-5


def quantised(position):
    return RESOLUTION * np.round(position / RESOLUTION)


@given(st.floats(-3.0, 3.0), st.integers(0, 99))
def test_a_pose_at_the_wrap_of_an_encoder_is_the_mean_on_the_circle(angle, seed):
    noisy = angle + 1e-4 * np.random.default_rng(seed).standard_normal(200)
    wrapped = (noisy + np.pi - 0.5) % (2.0 * np.pi) - np.pi + 0.5  # the wrap is anywhere
    rest = at_rest("slew", 0.005 * np.arange(200), wrapped, 1e-4, ENCODER_TURN_RAD)
    assert np.exp(1j * rest.position) == pytest.approx(np.exp(1j * angle), abs=1e-4)
    assert rest.noise == pytest.approx(1e-4, rel=0.3)


def test_a_joint_that_moves_is_not_at_rest():
    with pytest.raises(DataError, match=r"telescope is not at rest: it drifted by \+0\.01 in 2 s"):
        at_rest("telescope", np.linspace(0.0, 2.0, 400), np.linspace(0.0, 0.01, 400), 1e-4, None)


@pytest.mark.parametrize("seconds", [0.5, 2.0, 60.0])
def test_a_joint_that_sinks_is_where_it_was_at_the_beginning(seconds):
    """However long the record; what it sinks is no noise."""
    time = np.arange(0.0, seconds, 0.005)
    rest = at_rest(
        "inner_boom", 1.8e9 + time, quantised(0.3 - 1.14e-4 * time), RESOLUTION, ENCODER_TURN_RAD
    )
    assert rest.position == pytest.approx(0.3, abs=RESOLUTION)
    assert rest.sinking == pytest.approx(-1.14e-4, rel=0.25)
    assert rest.noise < RESOLUTION


@pytest.mark.parametrize("minutes", [0.1, 2.0, 20.0])
def test_what_a_lever_has_moved_is_told_from_what_has_sunk(minutes):
    time = np.arange(0.0, 60.0 * minutes, 0.005)
    by_lever = np.clip(0.05 * (time - 2.0), 0.0, 0.1)
    shaken = 2e-3 * np.sin(2.0 * np.pi * 1.3 * time) * np.exp(-((time - 3.0) ** 2))
    rest = Rest(0.3, 1e-5, RESOLUTION)
    sunk = quantised(0.3 - 1.14e-4 * time + shaken)
    assert moved(time, sunk, rest) == pytest.approx(0.0, abs=rest.movement)
    assert moved(time, sunk + by_lever, rest) == pytest.approx(0.1, abs=2.0 * rest.movement)


@given(st.sampled_from([-1, 1]), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(0.1, 1.0))
def test_zero_and_sign_turn_readings_into_angles(sign, zero, known, way):
    """Whatever it sank meanwhile, as long as both poses were read when they were entered."""
    rest = Rest(sign * known + zero, 1e-5, RESOLUTION)
    for sunk in (0.0, -0.05, -2.0 * way):
        total = way + sunk
        found = find_encoder("slew", rest, known, sign * way, sign * total, known + total)
        assert found.sign == sign
        assert found.sign * (rest.position - found.zero) == pytest.approx(known, abs=1e-9)
        assert found.scale == pytest.approx(1.0, abs=0.01)


def test_a_movement_within_the_noise_tells_no_sign():
    with pytest.raises(DataError, match="move the joint further"):
        find_encoder("slew", Rest(0.0, 1e-3, RESOLUTION), 0.0, 0.05, 0.05)


def test_an_encoder_behind_a_gear_is_found_out():
    with pytest.raises(DataError, match=r"a ratio of 2\.000"):
        find_encoder("slew", Rest(0.0, 0.0, RESOLUTION), 0.0, 0.4, 0.4, 0.2)


def test_a_second_pose_on_the_other_side_is_refused():
    with pytest.raises(DataError, match="not the direction in which it was moved"):
        find_encoder("slew", Rest(0.0, 0.0, RESOLUTION), 0.0, 0.4, 0.4, -0.4)


@given(st.floats(-9e5, 9e5), st.integers(0, 99))
def test_the_offset_of_a_vented_transducer_is_its_mean(offset, seed):
    readings = offset + 1e4 * np.random.default_rng(seed).standard_normal(400)
    found = find_offset("tank", readings)
    assert found.offset == pytest.approx(offset, abs=5.0 * found.std)
    assert found.std == pytest.approx(500.0, rel=0.2)
    assert not found.stuck


@pytest.mark.parametrize(
    ("readings", "reason"),
    [
        (np.full(100, 5e6), "supply reads 50.00 bar, an offset is at most 10 bar"),
        (np.linspace(0.0, 1e5, 100), "supply is not at rest"),
        (np.append(np.zeros(99), np.nan), "readings are missing"),
    ],
)
def test_what_is_no_offset_is_refused(readings, reason):
    with pytest.raises(DataError, match=reason):
        find_offset("supply", readings)


def test_a_transducer_that_says_always_the_same_is_named():
    assert find_offset("supply", np.zeros(100)).stuck


def nudge(command: float, direction: float) -> Nudge:
    return Nudge(command=command, moved=direction * 5e-4, displacement=direction * 1e-3)


@pytest.mark.parametrize("sign", [-1, 1])
def test_polarity_is_the_direction_of_the_first_movement(sign):
    up, down = nudge(0.08, sign), nudge(-0.07, -sign)
    assert find_polarity("slew", up, down).polarity == sign


def test_a_joint_that_sinks_at_both_commands_has_no_polarity():
    with pytest.raises(DataError, match="both in one direction"):
        find_polarity("slew", nudge(0.08, -1.0), nudge(-0.07, -1.0))


def ramped(dead_band, gain, lag, direction, seed, rate=0.05, over=0.06):
    """A valve with first-order lag, integrated by scipy; the encoder rounds and has noise."""
    turn = (dead_band + over) / rate

    def wanted(time):
        return np.maximum(0.0, rate * (turn - np.abs(time - turn)))

    def slope(time, state):
        spool, _ = state
        return [(wanted(time) - spool) / lag, gain * max(spool - dead_band, 0.0)]

    time = np.arange(0.0, 2.0 * turn + 0.5, 0.005)
    solution = solve_ivp(slope, (0.0, time[-1]), [0.0, 0.0], t_eval=time, max_step=0.01)
    noise = 2e-5 * np.random.default_rng(seed).standard_normal(len(time))
    return Trace(
        1.8e9 + time, direction * quantised(solution.y[1] + noise), direction * wanted(time)
    )


@pytest.mark.parametrize("direction", [-1, 1])
@pytest.mark.parametrize(
    ("dead_band", "gain", "lag"), [(0.05, 0.8, 0.05), (0.11, 0.4, 0.1), (0.02, 1.5, 0.02)]
)
def test_the_dead_band_is_found_without_the_lag(dead_band, gain, lag, direction):
    fits = [
        fit_dead_band("slew", ramped(dead_band, gain, lag, direction, seed), direction)
        for seed in range(3)
    ]
    found = average(fits, 0.05)
    assert found.dead_band == pytest.approx(dead_band, abs=1e-3)
    assert found.gain == pytest.approx(gain, rel=0.03)
    assert found.lag == pytest.approx(lag, abs=0.02)
    assert 0.0 < found.dead_band_std < 1e-3


def test_a_joint_that_goes_the_wrong_way_has_no_dead_band():
    with pytest.raises(DataError, match="no movement in the direction"):
        fit_dead_band("slew", ramped(0.05, 0.8, 0.05, 1, 0), -1)


@pytest.mark.parametrize("beyond", [-0.06, 0.06])
@pytest.mark.parametrize(("dead_time", "lag"), [(0.02, 0.05), (0.05, 0.1)])
def test_a_step_response_gives_gain_dead_time_and_lag(dead_time, lag, beyond):
    gain, time = 0.8, np.arange(0.0, 0.8, 0.005)
    delayed = np.where(time >= dead_time, beyond, 0.0)
    _, response, _ = lsim(TransferFunction([gain], [lag, 1.0, 0.0]), delayed, time)
    fit = fit_step(
        "slew", Trace(time, quantised(response) + 0.3, np.full_like(time, beyond)), beyond
    )
    assert fit.gain == pytest.approx(gain, rel=0.03)
    assert fit.dead_time + fit.lag == pytest.approx(dead_time + lag, abs=0.01)
    assert fit.fitted == pytest.approx(response + 0.3, abs=1e-3)


@given(st.floats(0.1, 3.0), st.floats(0.0, 0.2), st.floats(0.001, 0.2), st.floats(0.02, 1.0))
def test_first_gains_leave_margin(gain, dead_time, lag, fastest):
    """The loop kp K (1 + T s) exp(-L s) / (s (T s + 1)), with T cancelled: by its phase."""
    found = first_gains([StepFit(gain, dead_time, lag, np.zeros(1))], fastest, 0.05, 0.01)
    crossover = found.kp * gain  # rad/s, where the loop kp K exp(-L s) / s has the gain 1
    margin = np.pi / 2.0 - crossover * dead_time
    assert margin > np.radians(60.0)
    assert 1.0 / crossover >= fastest * (1.0 - 1e-9)
    assert found.kd * gain <= 0.5 * (1.0 + 1e-9)
    assert found.kp * found.position_tolerance < 0.05


def test_the_worst_response_decides():
    slow, fast = StepFit(0.5, 0.01, 0.02, np.zeros(1)), StepFit(1.0, 0.03, 0.05, np.zeros(1))
    assert first_gains([slow, fast], 0.2, 0.05, 0.01) == first_gains([fast], 0.2, 0.05, 0.01)
