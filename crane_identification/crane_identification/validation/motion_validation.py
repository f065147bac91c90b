"""Simulated against measured motion: how far a model drifts from the machine over a short horizon.

The second comparison beside predicted against measured force: from the measured state, driven by
the measured pressures, the model moves on its own for the horizon, again and again over the record.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_model.cylinders import cylinder_force, cylinder_forces_from_generalized
from crane_model.errors import DataError, RangeError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.simulation import simulate

HORIZON = 0.5  # s
LOGGED = (
    *("time", "run", "pressure_a", "pressure_b", "command", "temperature"),
    *("slew_position", "slew_velocity", "slew_acceleration"),
)
"""Fields of a record that do not come out of the simulation and that terms may ask for."""


@dataclass(frozen=True)
class MotionValidation:
    """Errors of simulated motion over N windows of `horizon` [s]; per joint (j,), rad or m.

    `position_rms` is the error at the end of the horizon, `displacement_rms` how far the joint
    itself moved by then, `relative` their ratio. Where the model cannot be simulated, `reason` says
    why, there is no window and the errors are NaN.
    """

    joints: tuple[str, ...]
    horizon: float
    windows: int
    position_rms: np.ndarray
    displacement_rms: np.ndarray
    reason: str = ""

    @property
    def relative(self) -> np.ndarray:
        """Error over displacement, (j,); nan where the joint does not move."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.position_rms / self.displacement_rms


def validate_motion(
    model: Model, records: Sequence[Record], horizon: float = HORIZON
) -> MotionValidation:
    """Simulate `model` over consecutive windows of uniformly sampled `records`.

    Windows do not cross from one run to the next. A model that does not move, as one without
    inertia, or that moves beyond all bounds, and records without a window or a drive, lose this
    comparison alone: it comes with the reason.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = _simulated(model, records, horizon)
        if np.isfinite(found.position_rms).all():
            return found
        reason = f"simulation of '{model.name}': the motion grows beyond all bounds"
    except (RangeError, DataError) as error:
        reason = str(error)
    unknown = np.full(len(model.joints), np.nan)
    return MotionValidation(model.joints, horizon, 0, unknown, unknown, reason)


def _simulated(model: Model, records: Sequence[Record], horizon: float) -> MotionValidation:
    errors, moved, length = [], [], horizon
    for record in records:
        period = float(np.median(np.diff(record.time)))
        samples = max(round(horizon / period), 1)
        starts = _window_starts(record, samples)
        if len(starts) == 0:
            continue
        at = starts[None, :] + np.arange(samples + 1)[:, None]  # (T, N)
        start = record.position[starts], record.velocity[starts]
        motion = simulate(
            model,
            *start,
            _drive(model, record)[at],
            period,
            beside=_logged(record, at),
            memory={term: term.trace(record, model.setting)[starts] for term in model.terms},
        )
        errors.append(motion.position[-1] - record.position[at[-1]])
        moved.append(record.position[at[-1]] - record.position[starts])
        length = samples * period
    if not errors:
        raise DataError(
            f"simulated motion: no window of {horizon} s fits into a run of the recordings; "
            "record longer ones"
        )
    error, displacement = np.concatenate(errors), np.concatenate(moved)
    return MotionValidation(model.joints, length, len(error), _rms(error), _rms(displacement))


def _logged(record: Record, at: np.ndarray) -> dict[str, np.ndarray]:
    """(T, N, ...) of what the record holds of these, at its samples `at` (T, N)."""
    values = {name: getattr(record, name) for name in LOGGED}
    return {name: value[at] for name, value in values.items() if value is not None}


def _window_starts(record: Record, length: int) -> np.ndarray:
    run = np.zeros(len(record), dtype=int) if record.run is None else record.run
    starts = np.arange(0, len(record) - length, length)
    return starts[run[starts] == run[starts + length]]


def _drive(model: Model, record: Record) -> np.ndarray:
    """Cylinder forces [N] where the model has linkages, generalized forces where not: (n, j)."""
    if model.machine is not None and record.pressure_a is not None:
        assert record.pressure_b is not None  # logged together
        pairs = zip(record.joints, record.pressure_a.T, record.pressure_b.T, strict=True)
        return np.stack([cylinder_force(model.machine, *pair) for pair in pairs], axis=1)
    if record.force is None:
        raise DataError("simulated motion: the record has neither pressures nor forces to drive it")
    if model.machine is None:
        return record.force
    return cylinder_forces_from_generalized(
        model.machine, record.position, record.force, record.joints
    )


def _rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt((error**2).mean(axis=0))
