"""A crane that obeys the report's model exactly, read by asynchronous sensors."""

import numpy as np

from crane_identification import Log, Signal
from crane_model import Machine, Model, Record, load_model
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file

START = 1_700_000_000_000_000_000  # ns
RATE = 200.0  # Hz
JITTER = 1e-4  # s
BEHIND = 2e-3  # s, by which pressures are read after the encoders
ENCODER = 4.794e-5
TRUE_VALUES = np.array(
    [450, 350, 8, 250, 170, 20, 130, 180]  # inertial, in the order of the packaged model
    + [900, 100, 1500, 200, 500, 50, 700, 80, 500, 60, 700, 90]  # friction of each joint
)
CENTRE = np.array([0.45, -1.3, 0.75])
AMPLITUDE = np.array([0.3, 0.6, 0.45])
HARMONICS = np.array([[1, 3, 7], [2, 3, 5], [1, 4, 6]])  # of each joint
PERIOD = 20.0  # s
STANDS = 1.0  # s, before it begins to move
SWING = np.array([3e-3, 12e-3, 0.0])  # rad, rad, m: on its oil, where it does
SWING_HARMONICS, SWING_SHARES = np.array([48, 49, 50]), np.array([-0.25, 0.5, -0.25])  # one burst


def crane() -> Model:
    return load_model(machine_file("model.yaml"))


def motion(
    time: np.ndarray, swing: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity, acceleration (n, 3); at rest until `STANDS`, then with a burst of `swing`
    (3,) at 2.5 Hz in every period.
    """
    omega = 2 * np.pi / PERIOD * HARMONICS
    share = AMPLITUDE[:, None] / (HARMONICS * (1 / HARMONICS).sum(axis=1, keepdims=True))
    angle = omega * np.maximum(time - STANDS, 0.0)[:, None, None]
    moves = (time > STANDS)[:, None]
    position = CENTRE + (share * (1 - np.cos(angle))).sum(axis=2) / 2
    velocity = (share * omega * np.sin(angle)).sum(axis=2) / 2
    acceleration = (share * omega**2 * np.cos(angle)).sum(axis=2) / 2 * moves
    omega = 2 * np.pi / PERIOD * SWING_HARMONICS
    angle = omega * np.maximum(time - STANDS, 0.0)[:, None]
    position += np.outer(np.cos(angle) @ SWING_SHARES, swing * np.ones(3))
    velocity -= np.outer(np.sin(angle) @ (SWING_SHARES * omega), swing * np.ones(3))
    acceleration -= np.outer(np.cos(angle) @ (SWING_SHARES * omega**2), swing * np.ones(3)) * moves
    return position, velocity, acceleration


def pressures(
    model: Model, time: np.ndarray, swing: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Chamber pressures (n, 3) that move the crane so."""
    machine = model.machine
    assert isinstance(machine, Machine)
    position, velocity, acceleration = motion(time, swing)
    record = Record(model.joints, time, position, velocity, acceleration)
    true_values = model.with_estimate(
        TRUE_VALUES.astype(float), np.zeros(len(TRUE_VALUES)), "true values"
    )
    drive = cylinder_forces_from_generalized(
        machine, position, true_values.predict(record), model.joints
    )
    areas = np.array(
        [(machine.cylinders[j].area_a, machine.cylinders[j].area_b) for j in model.joints]
    )
    chamber_b = np.full_like(drive, 3e6)
    return (drive + areas[:, 1] * chamber_b) / areas[:, 0], chamber_b


def record_log(
    seconds: float, seed: int = 0, noise: float = 1e4, swing: np.ndarray | float = 0.0
) -> Log:
    """What encoders and transducers (noise in Pa) read of it at 200 Hz, each at its own times."""
    rng = np.random.default_rng(seed)
    model = crane()
    nominal = np.arange(round(seconds * RATE)) / RATE
    encoder = np.round(nominal + rng.uniform(-JITTER, JITTER, len(nominal)), 9)
    encoder -= encoder[0]
    oil = np.round(nominal + BEHIND + rng.uniform(-JITTER, JITTER, len(nominal)), 9)
    chamber_a, chamber_b = pressures(model, oil, swing)
    position = ENCODER * np.round(motion(encoder, swing)[0] / ENCODER)
    return Log(
        source="synthetic crane",
        joints=model.joints,
        start=START,
        position=Signal(encoder, position, "/joint_states"),
        pressure_a=Signal(oil, chamber_a + noise * rng.standard_normal(oil.shape + (3,)), "a"),
        pressure_b=Signal(oil, chamber_b + noise * rng.standard_normal(oil.shape + (3,)), "b"),
    )
