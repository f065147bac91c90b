from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from crane_identification import Options
from crane_identification.data.sources import Sources
from crane_identification.estimation.autoregression import independent_samples
from crane_identification.preparation.periodicity import REPEATING_RMS_SHARE
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import (
    change_between_periods,
    drift,
    fold,
    noise_of_mean,
    resolution_of_mean,
    transient_periods,
)
from crane_model import load_model
from crane_model.machine_files import machine_file
from crane_model.progress_bar import silent
from crane_sim.make_bag import main as make_bag


@given(n=st.integers(1, 200), length=st.integers(1, 50), data=st.data())
def test_fold_takes_the_last_whole_periods(n: int, length: int, data: st.DataObject) -> None:
    periods = data.draw(st.integers(0, n // length))
    values = np.arange(n)
    folded = fold(values, length, periods)
    assert folded.shape == (periods, length)
    np.testing.assert_array_equal(folded.ravel(), values[n - periods * length :])


def noisy(periods: int, seed: int, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = np.sin(2 * np.pi * np.arange(400) / 400)[:, None] * np.array([1.0, 5.0])
    return truth, truth + noise * rng.normal(size=(periods, 400, 2))


def test_noise_of_mean_is_the_error_of_the_mean() -> None:
    """Against the truth, which the estimate has not seen."""
    truth, periods = noisy(periods=6, seed=1)
    used = np.ones((400, 2), dtype=bool)
    actual = np.sqrt(((periods.mean(axis=0) - truth) ** 2).mean(axis=0))
    np.testing.assert_allclose(noise_of_mean(periods, used), actual, rtol=0.1)


def test_noise_of_mean_counts_used_samples_only() -> None:
    _, periods = noisy(periods=4, seed=2)
    used = np.ones((400, 2), dtype=bool)
    used[100:200, 0] = False
    spoilt = periods.copy()
    spoilt[0, 100:200, 0] += 100.0
    np.testing.assert_array_equal(noise_of_mean(spoilt, used), noise_of_mean(periods, used))


def test_one_period_has_no_scatter() -> None:
    _, periods = noisy(periods=1, seed=3)
    assert np.isnan(noise_of_mean(periods, np.ones((400, 2), dtype=bool))).all()


@pytest.mark.parametrize("periods", [3, 4, 6])
def test_repeating_periods_are_all_kept(periods: int) -> None:
    assert transient_periods(noisy(periods, seed=4)[1]) == 0


def test_transient_of_one_joint_takes_its_periods_out() -> None:
    _, periods = noisy(5, seed=5)
    decay = np.exp(-np.arange(800) / 150).reshape(2, 400)
    periods[:2, :, 1] += 30.0 * decay
    assert transient_periods(periods) == 2


def test_two_periods_are_always_left() -> None:
    periods = np.geomspace(1000.0, 1.0, 4)[:, None, None] * np.ones((4, 50, 1))  # never settles
    assert transient_periods(periods) == 2
    assert transient_periods(periods[:2]) == 0


def test_drift_between_periods_is_told_from_scatter() -> None:
    """Of 300 joints without drift one in twenty looks like one at 5 %; a small one is found."""
    everywhere = np.ones((400, 2), dtype=bool)
    p_values = [drift(noisy(5, seed)[1], everywhere).p_value for seed in range(150)]
    assert 0.01 < np.mean(np.array(p_values) < 0.05) < 0.10
    _, periods = noisy(5, seed=200)
    periods[:, :, 1] += 0.02 * np.arange(5)[:, None]
    found = drift(periods, everywhere)
    assert found.p_value[1] < 1e-3
    assert found.p_value[0] > 1e-3
    assert found.rate[1] == pytest.approx(0.02, rel=0.5)


def test_scatter_in_bursts_is_no_drift() -> None:
    """As at reversals, where the periods stick at different times; counting the power as spread
    over the whole period would find a drift in one of three."""
    rng, at = np.random.default_rng(0), np.arange(1000)
    size = 0.05 + sum(np.exp(-0.5 * ((at - burst) / 15) ** 2) for burst in (100, 400, 420, 800))
    p_values = []
    for _ in range(200):
        noise = lfilter([1.0], [1.0, -0.8], rng.normal(size=(3, 1100)), axis=1)[:, 100:]
        p_values.append(
            drift((noise * size)[:, :, None], np.ones((1000, 1), dtype=bool)).p_value[0]
        )
    assert 0.01 < np.mean(np.array(p_values) < 0.05) < 0.15


def test_vibration_with_another_phase_in_each_period_is_no_drift() -> None:
    """A few cycles behind some reversals hold nearly all of the power; taken for noise that is
    independent from stretch to stretch they would be a drift in four of ten."""
    rng, at = np.random.default_rng(0), np.arange(1000)
    bursts = [np.exp(-0.5 * ((at - middle) / 12) ** 2) for middle in (100, 400, 800)]
    p_values = []
    for _ in range(200):
        phases = rng.uniform(0.0, 2 * np.pi, (3, 3, 1))
        vibration = sum(np.sin(0.3 * at + phases[i]) * burst for i, burst in enumerate(bursts))
        periods = vibration + 0.05 * rng.normal(size=(3, 1000))
        p_values.append(drift(periods[:, :, None], np.ones((1000, 1), dtype=bool)).p_value[0])
    assert np.mean(np.array(p_values) < 0.05) < 0.15
    assert np.mean(np.array(p_values) < 0.001) < 0.02


def test_two_periods_cannot_drift() -> None:
    found = drift(noisy(2, seed=6)[1], np.ones((400, 2), dtype=bool))
    assert np.isnan(found.rate).all() and np.isnan(found.p_value).all()


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_independent_samples_of_an_autoregression(correlation: float) -> None:
    """tr(C)²/tr(C²) = n (1 - r²)/(1 + r²), for long records."""
    rng, n = np.random.default_rng(7), 4000
    noise = lfilter([1.0], [1.0, -correlation], rng.normal(size=(4, n + 200)), axis=1)[:, 200:]
    deviation = (noise - noise.mean(axis=0))[:, :, None]
    found = independent_samples(deviation, np.ones((n, 1), dtype=bool))
    expected = n * (1 - correlation**2) / (1 + correlation**2)
    assert found[0] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("periods", [3, 6])
@pytest.mark.parametrize("samples", [50, 200])
def test_independent_samples_of_a_short_record(periods: int, samples: int) -> None:
    """White noise: all of them, though a variance from a few samples differs by chance."""
    rng = np.random.default_rng(9)
    noise = rng.normal(size=(periods, samples, 100))
    used = np.ones((samples, 100), dtype=bool)
    found = independent_samples(noise - noise.mean(axis=0), used)
    assert found.mean() == pytest.approx(samples, rel=0.1)


def test_equal_periods_round_alike_and_different_ones_do_not() -> None:
    resolution = np.array([0.01, 0.01])
    ramp = np.linspace(0.0, 3.0, 400)[None, :, None] * np.ones((4, 1, 2))
    ramp[:, :, 1] += np.random.default_rng(8).uniform(size=(4, 1))
    rounded = np.round(ramp / resolution) * resolution
    np.testing.assert_allclose(resolution_of_mean(rounded, resolution), [0.01, 0.005])
    np.testing.assert_array_equal(resolution_of_mean(rounded[:1], resolution), resolution)


def test_the_change_between_periods_is_without_white_noise() -> None:
    truth, force = noisy(6, seed=6)
    position = force.copy()
    resolution = np.full(2, 0.01)
    assert change_between_periods(position, force, resolution) < 0.05
    sign = np.array([1.0, -1.0] * 3)[:, None, None]
    changed = force + 0.2 * sign * truth
    expected = 0.2 * np.sqrt(6 / 5)  # standard deviation of six values of +-0.2
    assert change_between_periods(position, changed, resolution) == pytest.approx(expected, rel=0.1)
    assert change_between_periods(position, changed, np.full(2, 0.5)) == 0.0  # the motion repeats
    assert change_between_periods(position[:1], changed[:1], resolution) == 0.0


@pytest.mark.parametrize(
    ("machine", "averages"), [("laboratory_crane", True), ("field_excavator", False)]
)
def test_a_machine_that_hunts_is_not_averaged(tmp_path: Path, machine: str, averages: bool) -> None:
    """Valves that answer late: each period of the field machine is another one."""
    trajectory = str(machine_file("excitation_20s.yaml", machine))
    given = ["--machine", machine, "--trajectory", trajectory, "--periods", "3"]
    assert make_bag([*given, "--out", str(tmp_path / "bag")]) == 0
    model = load_model(machine_file("model.yaml", machine)).of_machine()
    options = Options()
    (log,) = Sources(model, None, options, silent).read([tmp_path / "bag"])
    (run,) = prepare(model, log, options)
    assert run.periodic == averages
    assert (run.changing > REPEATING_RMS_SHARE) != averages
    (asked,) = prepare(model, log, Options(period=20.0))
    assert asked.periodic
