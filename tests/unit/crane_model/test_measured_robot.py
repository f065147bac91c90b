"""A six-axis robot that was measured: the bodies of its machine file explain its motors' torques.

The reference fit of the data's README, made with Pinocchio: 58 base parameters, trained on A and B,
leave 3.1 % of the torque of C; trained on A alone, 38.8 %.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from scipy.signal import butter, filtfilt

from crane_model.base_parameters import reveal_rank
from crane_model.cylinders import generalized_from_actuators
from crane_model.machine import load_machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Setting
from crane_model.terms.friction import Viscous
from crane_model.terms.rotor_inertia import RotorInertia
from crane_model.terms.serial_rigid_body import SerialRigidBody
from crane_model.terms.single_axis import Offset

MACHINE = load_machine(Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml")
JOINTS = MACHINE.joint_names
PERIOD = 0.004  # s
USED = slice(450, 2050, 5)  # 1.8 to 8.2 s, a fifth of the samples


class Filtered(NamedTuple):
    columns: np.ndarray  # (n, 6, p)
    torque: np.ndarray  # (n, 6) at the joints, N m


def measured(folder: Path, name: str) -> Filtered:
    """As the README says: 40 Hz on positions, 10 Hz on both sides, tanh for Coulomb friction."""
    table = pl.read_parquet(folder / f"kuka_{name}.parquet")
    q, motors = (
        np.stack([table[key.format(i)].to_numpy() for i in range(1, 7)], axis=1)
        for key in ("q{}_rad", "tau_m{}_Nm")
    )
    q = smooth(q, 40.0)
    v = np.gradient(q, PERIOD, axis=0)
    record = Record(JOINTS, PERIOD * np.arange(len(q)), q, v, np.gradient(v, PERIOD, axis=0))
    terms = [SerialRigidBody()]
    terms += [kind(joint=joint) for kind in (RotorInertia, Viscous, Offset) for joint in JOINTS]
    columns = Model("robot", Setting(MACHINE.units, MACHINE), tuple(terms)).regressor(record)
    coulomb = np.tanh(v / 0.01)[:, :, np.newaxis] * np.eye(6)
    torque = generalized_from_actuators(MACHINE, q, motors, JOINTS)
    whole = np.concatenate([columns, coulomb], axis=2)
    return Filtered(smooth(whole, 10.0)[USED], smooth(torque, 10.0)[USED])


def smooth(values: np.ndarray, cut_off: float) -> np.ndarray:
    b, a = butter(4, cut_off * 2.0 * PERIOD)
    return filtfilt(b, a, values, axis=0)


@pytest.fixture(scope="module")
def recordings(real_data: Path) -> dict[str, Filtered]:
    if not (real_data / "kuka_kr300").is_dir():
        pytest.skip(f"no kuka_kr300 in {real_data}")
    return {name: measured(real_data / "kuka_kr300", name) for name in "ABC"}


def fit(parts: list[Filtered]) -> tuple[np.ndarray, int]:
    """Weighted least squares, each axis by its residual: Theta and the rank of the columns."""
    columns = np.concatenate([part.columns for part in parts])
    torque = np.concatenate([part.torque for part in parts])
    stacked = columns.reshape(-1, columns.shape[2])
    scale, spread = np.linalg.norm(stacked, axis=0), np.ones(6)
    for _ in range(3):
        weight = np.tile(1.0 / spread, len(columns))
        weighted = stacked / scale * weight[:, np.newaxis]
        theta = np.linalg.lstsq(weighted, torque.ravel() * weight, rcond=1e-9)[0] / scale
        spread = (torque - columns @ theta).std(axis=0)
    return theta, reveal_rank(stacked, 1e-6).rank


def error(part: Filtered, theta: np.ndarray) -> tuple[float, np.ndarray]:
    """Relative error [%] of all axes together, and of each (6,)."""
    rest = part.torque - part.columns @ theta
    each = np.linalg.norm(rest, axis=0) / np.linalg.norm(part.torque, axis=0)
    return 100.0 * float(np.linalg.norm(rest) / np.linalg.norm(part.torque)), 100.0 * each


def test_two_recordings_tell_the_third(recordings: dict[str, Filtered]) -> None:
    theta, rank = fit([recordings["A"], recordings["B"]])
    assert rank == 58
    whole, each = error(recordings["C"], theta)
    assert whole == pytest.approx(3.1, abs=0.2)
    np.testing.assert_allclose(each, [4.9, 3.2, 2.4, 19.8, 3.8, 8.3], atol=1.3)


def test_one_recording_alone_does_not(recordings: dict[str, Filtered]) -> None:
    """It fits itself, and misses the other: the trap that must be said."""
    theta, _ = fit([recordings["A"]])
    assert error(recordings["A"], theta)[0] == pytest.approx(3.2, abs=0.1)
    assert error(recordings["C"], theta)[0] > 30.0
