"""Logs of machines whose parameters are known: the equations of the report, sampled."""

from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_simpson

from crane_identification import Log, Signal
from crane_model import Model, Record, load_model
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file

PERIOD = 20.0
LEAD = 2.0  # s of other motion before and after the periods
RATE = 100.0
RESOLUTION = 1e-5
BACK_PRESSURE = 1e6  # Pa in chamber B
FORCE_NOISE = 3.0  # N per cylinder
AXIS_THETA = np.array([12.0, 30.0, 8.0, -1.5])

AXIS_MODEL = """
name: one axis
joints: {axis: m}
terms:
  - {type: inertia, joint: axis}
  - {type: viscous, joint: axis}
  - {type: coulomb, joint: axis}
  - {type: offset, joint: axis}
"""


def axis_model(folder: Path) -> Model:
    path = folder / "axis.yaml"
    path.write_text(AXIS_MODEL)
    return load_model(path)


def crane_model() -> Model:
    """The model of the suite with parameters of a plausible crane."""
    model = load_model(machine_file("model.yaml"))
    inertial = [480.0, 370.0, 18.0, 450.0, 260.0, 20.0, 150.0, 220.0]
    friction = [800.0, 180.0, 9000.0, -1600.0, 520.0, -110.0, 3200.0, 620.0]
    theta = np.array([*inertial, *friction, 720.0, 120.0, 1500.0, 330.0])
    return model.with_estimate(theta, np.zeros(20), "true values")


def motion(
    time: np.ndarray, middle: np.ndarray, amplitude: np.ndarray, k: np.ndarray, phase: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Harmonics k (h,) of the period for each of j joints, phase (j, h); position, velocity and
    acceleration (n, j)."""
    omega = 2 * np.pi / PERIOD * k
    angle = omega * time[:, None, None] + phase
    share = amplitude[:, None] / k**1.5
    return (
        middle + (share * np.sin(angle)).sum(axis=2),
        (share * omega * np.cos(angle)).sum(axis=2),
        (-share * omega**2 * np.sin(angle)).sum(axis=2),
    )


def crane_log(
    seed: int, periods: float = 2, model: Model | None = None, noise: float = FORCE_NOISE
) -> Log:
    """Periodic motion of the three planar joints; before and after it, faster motion."""
    model = model or crane_model()
    rng = np.random.default_rng(seed)
    assert model.machine is not None
    time, clock, rate, change = _course(periods)
    middle, amplitude = np.array([0.45, -1.4, 0.75]), np.array([0.3, 0.45, 0.35])
    q, v, a = motion(clock, middle, amplitude, np.arange(1, 6), rng.uniform(0, 2 * np.pi, (3, 5)))
    record = Record(model.joints, time, q, v * rate, a * rate**2 + v * change)
    tau = model.predict(record)
    force = cylinder_forces_from_generalized(model.machine, q, tau, model.joints)
    force += noise * rng.normal(size=force.shape)
    cylinders = [model.machine.cylinders[joint] for joint in model.joints]
    area_a, area_b = (np.array([getattr(c, name) for c in cylinders]) for name in AREAS)
    pressure_b = np.full_like(force, BACK_PRESSURE)
    return Log(
        source=f"crane {seed}",
        joints=model.joints,
        start=0,
        position=Signal(time, RESOLUTION * np.round(q / RESOLUTION), "/joint_states"),
        pressure_a=Signal(time, (force + area_b * pressure_b) / area_a, "/cylinder_pressures"),
        pressure_b=Signal(time, pressure_b, "/cylinder_pressures"),
        reference_position=Signal(time, q, "/joint_reference"),
    )


AREAS = ("area_a", "area_b")


def axis_log(
    seed: int,
    model: Model,
    periods: float = 3,
    noise: float = 0.5,
    dead_band: float = 0.0,
    theta: np.ndarray = AXIS_THETA,
) -> Log:
    """Periodic motion of one axis with a measured drive force.

    Below the speed `dead_band` [m/s] the axis stands, and the force passes from the one branch of
    friction to the other.
    """
    rng = np.random.default_rng(seed)
    time, clock, rate, change = _course(periods)
    odd = np.array([1, 3, 5])  # to and fro alike, so that a dead band leaves no drift
    q, v, a = motion(clock, np.zeros(1), np.full(1, 0.4), odd, rng.uniform(0, 2 * np.pi, (1, 3)))
    moves = np.abs(v[:, 0]) >= dead_band
    instants = np.arange(len(time))
    direction = np.interp(instants, instants[moves], np.sign(v[moves, 0]))[:, None]
    if dead_band > 0.0:
        v = np.where(moves[:, None], v - dead_band * np.sign(v), 0.0)
        a = np.where(moves[:, None], a, 0.0)
        q = cumulative_simpson(v * rate, x=time, axis=0, initial=0.0)
    record = Record(
        model.joints, time, q, v * rate, a * rate**2 + v * change, direction_known=direction
    )
    force = model.with_estimate(theta, np.zeros(4), "true values").predict(record)
    return Log(
        source=f"axis {seed}",
        joints=model.joints,
        start=0,
        position=Signal(time, RESOLUTION * np.round(q / RESOLUTION), "q"),
        force=Signal(time, force + noise * rng.normal(size=force.shape), "f"),
        reference_position=Signal(time, q, "r"),
    )


def _course(periods: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), and the clock of the motion with its two derivatives, (n,), (n, 1), (n, 1).

    It runs up to twice as fast in the middle of each lead.
    """
    end = LEAD + periods * PERIOD
    time = np.arange(0.0, end + LEAD, 1 / RATE)
    outside = (time < LEAD) | (time > end)
    phase = np.pi * np.where(time < LEAD, time - LEAD, time - end) / LEAD * outside
    ahead = (phase - np.sin(phase) * np.cos(phase)) * LEAD / (2 * np.pi)
    rate, change = 1.0 + np.sin(phase) ** 2, np.pi / LEAD * np.sin(2 * phase)
    return time, time - LEAD + ahead, rate[:, None], change[:, None]
