"""Recordings of a planar crane that obeys the report's model, with known parameters and noise."""

import numpy as np

from crane_identification import Log, Signal
from crane_model import Model, Record, load_machine, load_model
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file

RATE = 100.0  # Hz
TRUE_VALUES = dict(
    zip(
        [p.name for p in load_model(machine_file("model.yaml")).parameters],
        [450, 350, 8, 400, 170, 20, 130, 180]  # inertial, as in crane_model.base_parameters
        + [900, 100, 1500, 200, 500, 50, 700, 80, 500, 60, 700, 90],  # friction of each joint
        strict=True,
    )
)
CENTRE = np.array([0.45, -1.3, 0.75])
AMPLITUDE = np.array([0.35, 0.7, 0.55])
ENCODER = np.array([1e-4, 1e-4, 1e-4])
PRESSURE_NOISE = 2e4  # Pa


def crane_model() -> Model:
    return load_model(machine_file("model.yaml"))


def record_crane(
    source: str, seed: int, period: float = 12.0, periods: float = 3.0, harmonics: int = 4
) -> Log:
    """A log of a periodic motion with quantised encoders and noisy chamber pressures."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(periods * period * RATE)) / RATE
    position, velocity, acceleration = _fourier(rng, time, period, harmonics)
    lag = 0.05 * velocity  # the machine follows its reference a little late
    record = Record(
        joints=crane_model().joints,
        time=time,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
    )
    machine = load_machine()
    theta = np.array(list(TRUE_VALUES.values()), dtype=float)
    model = crane_model().with_estimate(theta, 0 * theta, "true values")
    drive = cylinder_forces_from_generalized(machine, position, model.predict(record), model.joints)
    areas = np.array(
        [(machine.cylinders[j].area_a, machine.cylinders[j].area_b) for j in model.joints]
    )
    pressure_b = np.full_like(drive, 2e6)
    pressure_a = (drive + areas[:, 1] * pressure_b) / areas[:, 0]
    noise = PRESSURE_NOISE * rng.standard_normal((2, *drive.shape))
    measured = ENCODER * np.round(position / ENCODER)
    signals = {
        "position": measured,
        "pressure_a": pressure_a + noise[0],
        "pressure_b": pressure_b + noise[1],
        "reference_position": position + lag,
        "reference_velocity": velocity + 0.05 * acceleration,
        "reference_acceleration": acceleration + 0.05 * np.gradient(acceleration, time, axis=0),
    }
    return Log(
        source=source,
        joints=model.joints,
        start=0,
        **{name: Signal(time, values, name) for name, values in signals.items()},
    )


def _fourier(
    rng: np.random.Generator, time: np.ndarray, period: float, harmonics: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration (n, 3) of a random Fourier series (32)-(34)."""
    order = np.arange(1, harmonics + 1)
    omega = 2 * np.pi * order / period
    phase = omega * time[:, np.newaxis]
    weight = rng.standard_normal((2, harmonics, 3)) / order[:, np.newaxis]
    sine, cosine = np.sin(phase), np.cos(phase)
    scale = AMPLITUDE / np.abs(sine @ weight[0] + cosine @ weight[1]).max(axis=0)
    a, b = weight[0] * scale, weight[1] * scale
    turn = omega[:, np.newaxis]
    return (
        CENTRE + sine @ a + cosine @ b,
        cosine @ (turn * a) - sine @ (turn * b),
        -sine @ (turn**2 * a) - cosine @ (turn**2 * b),
    )
