"""The sensor chain: quantisation, noise, saturation and jitter as its file says."""

import numpy as np
import pytest
from laboratory_crane import JOINTS
from scipy.stats import chi2

from crane_model import Machine
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_model.sensors import SensorChain, in_counts

SAMPLES = 20_000


@pytest.fixture(scope="module")
def sensors() -> SensorChain:
    return load(machine_file("sensors.yaml"), SensorChain)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(18)


def assert_standard_deviation(samples: np.ndarray, expected: float) -> None:
    """Within the bounds that a sample variance keeps in all but one case in 10,000."""
    degrees = samples.size - 1
    low, high = chi2.ppf([5e-5, 1 - 5e-5], degrees) / degrees
    assert low < samples.var(ddof=1) / expected**2 < high


@pytest.mark.parametrize("joint", JOINTS)
def test_encoder_reads_the_nearest_count(
    sensors: SensorChain, rng: np.random.Generator, joint: str
) -> None:
    step = sensors.encoder_resolution[joint]
    q = rng.uniform(-2.0, 2.0, SAMPLES)
    read = in_counts(q, sensors.counts([joint]))
    assert np.abs(read - q).max() <= step / 2 * (1 + 1e-9)
    assert len(np.unique(read)) > SAMPLES / 10
    np.testing.assert_allclose(read / step, np.round(read / step), atol=1e-6)
    assert_standard_deviation_of_quantisation(read - q, step)


def assert_standard_deviation_of_quantisation(error: np.ndarray, step: float) -> None:
    assert error.std() == pytest.approx(step / np.sqrt(12.0), rel=0.02)


def test_all_encoders_at_once_read_like_each_alone(
    sensors: SensorChain, rng: np.random.Generator
) -> None:
    q = rng.uniform(-2.0, 2.0, (50, 4))
    together = in_counts(q, sensors.counts(JOINTS))
    for i, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(together[:, i], in_counts(q[:, i], sensors.counts([joint])))


def test_pressure_noise_and_quantisation(sensors: SensorChain, rng: np.random.Generator) -> None:
    true = rng.uniform(50e5, 150e5, SAMPLES)
    read = sensors.measure_pressure(rng, true)
    noise = np.hypot(sensors.pressure_noise, sensors.pressure_step / np.sqrt(12.0))
    assert_standard_deviation(read - true, noise)
    assert abs((read - true).mean()) < 4.0 * noise / np.sqrt(SAMPLES)


def test_pressure_comes_in_counts_of_the_converter(
    sensors: SensorChain, rng: np.random.Generator
) -> None:
    assert sensors.pressure_step == 250e5 / 4095  # 12 bits over 250 bar
    counts = sensors.measure_pressure(rng, rng.uniform(0, 250e5, SAMPLES)) / sensors.pressure_step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert 0 <= counts.min() < counts.max() <= 4095.001


@pytest.mark.parametrize(("pressure", "reading"), [(-5e5, 0.0), (300e5, 250e5)])
def test_pressure_saturates(
    sensors: SensorChain, rng: np.random.Generator, pressure: float, reading: float
) -> None:
    read = sensors.measure_pressure(rng, np.full((100, 3), pressure))
    assert read.shape == (100, 3)
    np.testing.assert_allclose(read, reading, rtol=1e-12)


def test_force_noise_is_the_scatter_of_measured_forces(
    sensors: SensorChain, machine: Machine, rng: np.random.Generator
) -> None:
    """Noise of both chambers through (19)."""
    cylinder = machine.cylinders["outer_boom"]
    p_a, p_b = rng.uniform(50e5, 150e5, (2, SAMPLES))
    read_a, read_b = (sensors.measure_pressure(rng, p) for p in (p_a, p_b))
    error = cylinder.area_a * (read_a - p_a) - cylinder.area_b * (read_b - p_b)
    assert_standard_deviation(error, sensors.force_noise(machine, "outer_boom"))


def test_sampling_instants_scatter_about_the_period(
    sensors: SensorChain, rng: np.random.Generator
) -> None:
    time = sensors.sample_times(rng, 3.0, SAMPLES)
    deviation = time - (3.0 + sensors.period * np.arange(SAMPLES))
    assert_standard_deviation(deviation, sensors.jitter)
    assert (np.diff(time) > 0.0).all()


def test_strong_jitter_does_not_reorder_samples(
    sensors: SensorChain, rng: np.random.Generator
) -> None:
    shaky = sensors.model_copy(update={"jitter": 2.0 * sensors.period})
    intervals = np.diff(shaky.sample_times(rng, 0.0, SAMPLES))
    assert intervals.min() > 0.05 * sensors.period
    assert intervals.std() > 0.3 * sensors.period


def test_ideal_sensors_add_nothing(sensors: SensorChain, rng: np.random.Generator) -> None:
    ideal = sensors.model_copy(update={"jitter": 0.0, "pressure_noise": 0.0, "pressure_bits": 24})
    np.testing.assert_array_equal(ideal.sample_times(rng, 0.0, 5), sensors.period * np.arange(5))
    read = ideal.measure_pressure(rng, np.array([123e5]))
    assert read == pytest.approx(123e5, abs=ideal.pressure_step / 2 * (1 + 1e-9))


def test_same_seed_same_noise(sensors: SensorChain) -> None:
    reads = [
        sensors.measure_pressure(np.random.default_rng(19), np.full(10, 1e7)) for _ in range(2)
    ]
    np.testing.assert_array_equal(*reads)
