"""Simulated against measured motion: how far a model drifts from the machine over a short horizon.

The second comparison beside predicted against measured force: from the measured state, driven by
the measured pressures, the model moves on its own for the horizon, again and again over the record.
"""

from dataclasses import dataclass

import numpy as np

from crane_model.cylinders import cylinder_force
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.simulation import simulate

HORIZON = 0.5  # s


@dataclass(frozen=True)
class MotionValidation:
    """Errors of simulated motion over N windows of `horizon` [s]; per joint (j,), rad or m.

    `position_rms` is the error at the end of the horizon, `displacement_rms` how far the joint
    itself moved by then, `relative` their ratio.
    """

    joints: tuple[str, ...]
    horizon: float
    windows: int
    position_rms: np.ndarray
    displacement_rms: np.ndarray

    @property
    def relative(self) -> np.ndarray:
        """Error over displacement, (j,); nan where the joint does not move."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.position_rms / self.displacement_rms


def validate_motion(model: Model, record: Record, horizon: float = HORIZON) -> MotionValidation:
    """Simulate `model` over consecutive windows of a uniformly sampled `record`.

    Windows do not cross from one run to the next. `DataError` if the record is shorter than one
    window or carries no force that could drive the model.
    """
    period = float(np.median(np.diff(record.time)))
    length = max(round(horizon / period), 1)
    starts = _window_starts(record, length)
    if len(starts) == 0:
        raise DataError(
            f"simulated motion: no window of {horizon} s fits into a run of the record; "
            f"it has {len(record)} samples {period:.4g} s apart"
        )
    at = starts[None, :] + np.arange(length + 1)[:, None]  # (T, N)
    drive = _drive(model, record)[at]
    start = record.position[starts], record.velocity[starts]
    motion = simulate(model, *start, drive, period)
    error = motion.position[-1] - record.position[at[-1]]
    moved = record.position[at[-1]] - record.position[starts]
    return MotionValidation(record.joints, length * period, len(starts), _rms(error), _rms(moved))


def _window_starts(record: Record, length: int) -> np.ndarray:
    run = np.zeros(len(record), dtype=int) if record.run is None else record.run
    starts = np.arange(0, len(record) - length, length)
    return starts[run[starts] == run[starts + length]]


def _drive(model: Model, record: Record) -> np.ndarray:
    """Cylinder forces (19) where the model has linkages, generalized forces where not: (n, j)."""
    if model.machine is None:
        if record.force is None:
            raise DataError("simulated motion: the record has no force to drive the model with")
        return record.force
    if record.pressure_a is None or record.pressure_b is None:
        raise DataError("simulated motion: the record has no chamber pressures to drive the model")
    columns = [
        cylinder_force(model.machine, joint, record.pressure_a[:, i], record.pressure_b[:, i])
        for i, joint in enumerate(record.joints)
    ]
    return np.stack(columns, axis=1)


def _rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt((error**2).mean(axis=0))
