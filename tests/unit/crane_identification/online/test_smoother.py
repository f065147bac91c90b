"""The smoothing operator against analytic signals, quadrature and its own definition."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import quad

from crane_identification.online.streams import FixedLagSmoother, Smoothed

LAG, PERIOD, GAP = 0.2, 0.05, 0.025
START = 1_700_000_000_000_000_000
KERNEL = Polynomial([945 / 512, 0, -3465 / 512]) * Polynomial([1, 0, -1]) ** 3


def stamps(seconds: float, jitter: float = 1e-4, rate: float = 200.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    nominal = np.arange(round(seconds * rate)) / rate
    return START + np.round(1e9 * (nominal + jitter * rng.standard_normal(len(nominal)))).astype(
        np.int64
    )


def smoothed(times: np.ndarray, values: np.ndarray, carried: np.ndarray) -> list[Smoothed]:
    smoother = FixedLagSmoother(values.shape[1], LAG, PERIOD, GAP)
    out = []
    for stamp, value, carried_value in zip(times.tolist(), values, carried, strict=True):
        out += smoother.add(stamp, value, carried_value)
    return out


def seconds(times: np.ndarray) -> np.ndarray:
    return (times - START) / 1e9


def test_every_row_is_on_the_grid_of_the_clock_and_one_lag_old() -> None:
    times = stamps(3.0)
    smoother = FixedLagSmoother(1, LAG, PERIOD, GAP)
    for stamp in times.tolist():
        for row in smoother.add(stamp, np.zeros(1), np.zeros(0)):
            assert row.stamp % int(PERIOD * 1e9) == 0
            assert LAG <= (stamp - row.stamp) / 1e9 < LAG + 0.006


def test_a_straight_line_is_exact_under_any_jitter() -> None:
    times = stamps(3.0, jitter=1.5e-3)
    times.sort()
    line = 0.7 - 0.3 * seconds(times)[:, None]
    for row in smoothed(times, line, line):
        expected = 0.7 - 0.3 * (row.stamp - START) / 1e9
        assert row.position[0] == pytest.approx(expected, abs=1e-10)
        assert row.carried[0] == pytest.approx(expected, abs=1e-10)
        assert row.velocity[0] == pytest.approx(-0.3, abs=1e-8)
        assert row.acceleration[0] == pytest.approx(0.0, abs=1e-6)


def test_a_cubic_is_left_as_it_is() -> None:
    times = stamps(3.0)
    cubic = Polynomial([0.1, -0.4, 0.3, 0.2])
    values = cubic(seconds(times))[:, None]
    for row in smoothed(times, values, values):
        t = (row.stamp - START) / 1e9
        assert row.position[0] == pytest.approx(cubic(t), abs=2e-5)
        assert row.velocity[0] == pytest.approx(cubic.deriv()(t), abs=1e-4)
        assert row.acceleration[0] == pytest.approx(cubic.deriv(2)(t), abs=1e-2)


@pytest.mark.parametrize("frequency", [0.2, 1.0, 3.0])
def test_motion_and_force_see_the_response_of_the_kernel(frequency: float) -> None:
    """A sine comes out times H(f), its derivatives exactly those of what comes out."""
    response = quad(lambda u: KERNEL(u) * np.cos(2 * np.pi * frequency * LAG * u), -1, 1)[0]
    times = stamps(4.0)
    omega = 2 * np.pi * frequency
    sine = np.sin(omega * seconds(times))[:, None]
    rows = smoothed(times, sine, sine)
    t = np.array([(row.stamp - START) / 1e9 for row in rows])
    # linear interpolation between readings takes away (omega step)^2 / 12
    near = {"rtol": 0, "atol": 2 * (omega * 0.005) ** 2 / 12 + 1e-5}
    position = np.array([row.position[0] for row in rows])
    np.testing.assert_allclose(position, response * np.sin(omega * t), **near)
    np.testing.assert_allclose(
        np.array([row.velocity[0] for row in rows]) / omega, response * np.cos(omega * t), **near
    )
    np.testing.assert_allclose(
        np.array([row.acceleration[0] for row in rows]) / omega**2,
        -response * np.sin(omega * t),
        **near,
    )
    np.testing.assert_array_equal([row.carried[0] for row in rows], position)


def test_half_power_at_the_stated_frequency() -> None:
    response = quad(lambda u: KERNEL(u) * np.cos(2 * np.pi * 0.78 * u), -1, 1)[0]
    assert response**2 == pytest.approx(0.5, abs=0.01)


def test_velocity_noise_is_as_stated() -> None:
    times = stamps(60.0)
    noise = np.random.default_rng(1).standard_normal((len(times), 3))
    rows = smoothed(times, noise, noise)
    found = np.std([row.velocity for row in rows])
    assert found == pytest.approx(rows[0].velocity_gain, rel=0.1)


def test_a_gap_begins_a_new_run_that_knows_nothing_of_the_old_one() -> None:
    times = stamps(2.0, jitter=0.0)
    times[200:] += 100_000_000
    values = np.where(np.arange(len(times)) < 200, 5.0, 0.0)[:, None]
    rows = smoothed(times, values, values)
    assert {row.run for row in rows} == {0, 1}
    for row in rows:
        assert row.position[0] == pytest.approx(5.0 if row.run == 0 else 0.0, abs=1e-9)
    first = next(row for row in rows if row.run == 1)
    assert first.stamp >= times[200] + LAG * 1e9


def test_a_single_missing_reading_is_no_gap() -> None:
    times = np.delete(stamps(2.0), [100, 150, 151])
    values = np.sin(seconds(times))[:, None]
    assert {row.run for row in smoothed(times, values, values)} == {0}


def test_repeated_and_late_stamps_change_nothing() -> None:
    times = stamps(2.0)
    values = np.sin(seconds(times))[:, None]
    again = np.repeat(times, 2)
    wrong = np.repeat(values, 2, axis=0)
    wrong[1::2] = 100.0
    smoother = FixedLagSmoother(1, LAG, PERIOD, GAP)
    rows = []
    for stamp, value in zip(again.tolist(), wrong, strict=True):
        rows += smoother.add(stamp, value, value)
    expected = smoothed(times, values, values)
    assert smoother.repeated == len(times)
    assert [row.position for row in rows] == [row.position for row in expected]


def test_a_clock_that_goes_back_begins_a_new_run() -> None:
    times = stamps(1.0, jitter=0.0)
    values = np.ones((len(times), 1))
    rows = smoothed(
        np.concatenate([times, times]), np.vstack([values] * 2), np.vstack([values] * 2)
    )
    assert [row.run for row in rows] == sorted(row.run for row in rows)
    halves = [[row.stamp for row in rows if row.run == run] for run in (0, 1)]
    assert halves[0] == halves[1]


def test_it_runs_for_hours_in_bounded_memory() -> None:
    smoother = FixedLagSmoother(1, LAG, PERIOD, GAP)
    count = 0
    for k in range(60_000):
        for row in smoother.add(START + k * 5_000_000, np.ones(1), np.zeros(0)):
            count += 1
            assert row.position[0] == pytest.approx(1.0, abs=1e-9)
    assert count == 60_000 * 0.005 / PERIOD - 2 * LAG / PERIOD


def test_a_gap_wider_than_half_the_lag_is_refused() -> None:
    with pytest.raises(ValueError, match="at most half the lag"):
        FixedLagSmoother(1, LAG, PERIOD, 0.6 * LAG)
