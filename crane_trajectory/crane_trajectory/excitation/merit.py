"""How well a trajectory determines the parameters of a model: condition numbers and predictions."""

from typing import Annotated

import numpy as np
from pydantic import Field

from crane_model.configuration import Positive, Schema
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_trajectory.excitation.columns import (
    ColumnSet,
    column_map,
    has_report_columns,
    inertial_columns,
)
from crane_trajectory.motion.fourier import FourierTrajectory, MotionSamples

UNSEEN = 1e-9
"""Share of a parameter in what recordings do not tell, below which they determine it."""


class PredictedRecording(Schema):
    """The recording for which standard deviations are predicted."""

    periods: Annotated[int, Field(ge=1)]
    sample_rate: Positive  # Hz
    noise: dict[str, Positive]  # joint -> standard deviation of its generalized force [N m, N]


def record_of(model: Model, samples: MotionSamples, direction: np.ndarray | None = None) -> Record:
    """Samples (n, j) of a reference as the model takes them; `direction` in place of sgn(q')."""
    return Record(
        joints=model.joints,
        time=np.arange(len(samples.position), dtype=float),
        position=samples.position,
        velocity=samples.velocity,
        acceleration=samples.acceleration,
        direction_known=direction,
    )


def condition_numbers(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Raw and column-normalised condition number of Phi from Phi^T Phi; any leading axes.

    The Gram matrix squares the numbers, so they are exact to about 1e-16 times their square.
    """
    norm = np.sqrt(np.diagonal(gram, axis1=-2, axis2=-1))
    scale = np.where(norm > 0.0, norm, 1.0)
    return _root_ratio(gram), _root_ratio(gram / (scale[..., :, None] * scale[..., None, :]))


def _root_ratio(gram: np.ndarray) -> np.ndarray:
    eigenvalues = np.linalg.eigvalsh(gram)
    smallest = np.maximum(eigenvalues[..., 0], np.finfo(float).eps * eigenvalues[..., -1])
    return np.sqrt(eigenvalues[..., -1] / smallest)


def information(
    model: Model, regressor: np.ndarray, period: float, experiment: PredictedRecording
) -> np.ndarray:
    """(p, p) inverse covariance of the parameters that one recording gives, white force noise.

    regressor (n, j, p) over one period; the information of several recordings adds up.
    """
    noise = np.array([experiment.noise[joint] for joint in model.joints])
    weighted = (regressor / noise[:, None]).reshape(-1, regressor.shape[-1])
    recorded = experiment.periods * period * experiment.sample_rate / len(regressor)
    return recorded * weighted.T @ weighted


def relative_std_devs(
    model: Model, information: np.ndarray, plausible: dict[str, float]
) -> dict[str, float]:
    """Predicted standard deviation of each parameter that has a plausible value, relative to it.

    Those that the recordings do not determine are left out: one trajectory of a campaign alone may
    tell nothing of some.
    """
    scale = np.sqrt(np.diag(information))
    scale[scale == 0.0] = 1.0
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    seen = eigenvalues > len(scale) * np.finfo(float).eps * eigenvalues[-1]
    std_devs = np.sqrt((vectors[:, seen] ** 2 / eigenvalues[seen]).sum(axis=1)) / scale
    determined = (vectors[:, ~seen] ** 2).sum(axis=1) < UNSEEN
    return {
        parameter.name: float(std_dev / abs(plausible[parameter.name]))
        for parameter, std_dev, known in zip(model.parameters, std_devs, determined, strict=True)
        if known and parameter.name in plausible
    }


def _motion(model: Model, trajectory: FourierTrajectory, samples: int) -> MotionSamples:
    """One period of a trajectory, with the columns of the model's joints."""
    if missing := [joint for joint in model.joints if joint not in trajectory.joint_names]:
        raise ConfigurationError(
            f"trajectory '{trajectory.name}': does not move {', '.join(missing)}, a joint of the "
            f"model '{model.name}'; it moves {', '.join(trajectory.joint_names)}"
        )
    motion = trajectory.evaluate(np.arange(samples) * trajectory.period / samples)
    columns = [trajectory.joint_names.index(joint) for joint in model.joints]
    return MotionSamples(*(np.ascontiguousarray(one[:, columns]) for one in motion))


def one_period(model: Model, trajectory: FourierTrajectory, samples: int) -> np.ndarray:
    """The regressor (samples, j, p) over one period of a trajectory of the model's joints."""
    return model.regressor(record_of(model, _motion(model, trajectory, samples)))


def figures_of_merit(
    model: Model,
    trajectory: FourierTrajectory,
    samples: int,
    experiment: PredictedRecording,
    plausible: dict[str, float],
) -> dict[str, float]:
    """Condition numbers of the model's columns and of those of (9), peak accelerations, predicted
    relative std devs.

    The trajectory moves the model's joints; `samples` are taken of one period. Figures of (9) are
    left out for a model that does not have its columns.
    """
    regressor = one_period(model, trajectory, samples)
    stacked = regressor.reshape(-1, len(model.parameters))
    gram = stacked.T @ stacked
    merit = _conditions("condition_number", gram, inertial_columns(model))
    if has_report_columns(model):
        change = column_map(model, ColumnSet.REPORT)
        reported = change.T @ gram @ change
        merit |= _conditions("condition_number_report", reported, inertial_columns(model))
    motion = _motion(model, trajectory, samples)
    peaks = np.abs(motion.acceleration).max(axis=0).tolist()
    merit |= {f"peak_acceleration.{j}": peak for j, peak in zip(model.joints, peaks, strict=True)}
    told = information(model, regressor, trajectory.period, experiment)
    predicted = relative_std_devs(model, told, plausible)
    return merit | {f"relative_std_dev.{name}": value for name, value in predicted.items()}


def _conditions(name: str, gram: np.ndarray, inertial: np.ndarray) -> dict[str, float]:
    raw, normalised = condition_numbers(gram)
    merit = {name: float(raw), f"{name}_normalised": float(normalised)}
    if inertial.any():
        only = gram[np.ix_(inertial, inertial)]
        merit[f"{name}_inertial"] = float(condition_numbers(only)[0])
    return merit
