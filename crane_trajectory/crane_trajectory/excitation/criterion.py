"""Criteria of (35), and how well a trajectory determines the parameters of a model.

Criteria are functions of Phi^T Phi that are small where the parameters are determined well.
Condition numbers depend on which columns count and, but for the normalised one, on their units, so
the column set is named; a condition number compares only within one set. D- and A-optimality do not
depend on units; they weigh the rows by the noise of their joints. In a search power means replace
the largest and the smallest eigenvalue: where the smallest two are equal, as they are at good
trajectories, the condition number has no gradient.
"""

from enum import StrEnum
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from crane_model.base_parameters import report_from_base
from crane_model.configuration import Positive, Schema
from crane_model.dynamics import Geometry
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms.rigid_body import BASE_PARAMETERS
from crane_trajectory.motion.periodic import FourierTrajectory, MotionSamples

POWER = 8.0  # of the power means over eigenvalues of Phi^T Phi
UNSEEN = 1e-9
"""Share of a parameter in what recordings do not tell, below which they determine it."""


class ColumnSet(StrEnum):
    """Which columns count."""

    BASE = "base"  # all columns of the model
    REPORT = "report"  # those of (9), and of all other terms
    INERTIAL = "inertial"  # those of the rigid bodies alone


def column_map(model: Model, columns: ColumnSet) -> np.ndarray:
    """(p, c): Phi times this is the regressor of the c columns of the set.

    Raises `ConfigurationError` if the model has no columns of (9).
    """
    identity = np.eye(len(model.parameters))
    if columns is ColumnSet.BASE:
        return identity
    if columns is ColumnSet.INERTIAL:
        return identity[:, inertial_columns(model)]
    if not model.terms[0].has_base_parameters:
        raise ConfigurationError(
            f"model '{model.name}': the columns of (9) are those of the term planar_rigid_body, "
            "which must be its first"
        )
    assert model.machine is not None  # a model of planar_rigid_body has one
    from scipy.linalg import block_diag  # half a second to import

    count = len(BASE_PARAMETERS)
    to_report = report_from_base(Geometry.of(model.machine))  # xi_(9) = T xi, so Phi T^-1
    return block_diag(np.linalg.inv(to_report), identity[count:, count:])


def inertial_columns(model: Model) -> np.ndarray:
    """(p,) which columns of the regressor belong to rigid bodies (8), not to friction."""
    return np.concatenate(
        [np.full(len(term.parameters(model.setting)), term.has_inertia()) for term in model.terms]
    )


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
    return MotionSamples(*(np.ascontiguousarray(samples[:, columns]) for samples in motion))


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
    if model.terms[0].has_base_parameters:
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


class CriterionKind(StrEnum):
    """Criterion to minimise."""

    RAW = "raw"  # cond(Phi)
    NORMALISED = "normalised"  # cond(Phi with columns of length 1)
    PRODUCT = "product"  # of the two: each alone leaves some parameters poorly determined
    D_OPTIMALITY = "d-optimality"  # the volume of the ellipsoid of uncertainty
    A_OPTIMALITY = "a-optimality"  # mean square of predicted relative standard deviations


class CriterionValue(NamedTuple):
    """A criterion and its derivative with respect to Phi^T Phi, a symmetric (p, p)."""

    value: float
    slope: np.ndarray


def log_condition(gram: np.ndarray, power: float = POWER) -> CriterionValue:
    """log cond(Phi) from Phi^T Phi (p, p), by power means; approached from above by the power."""
    eigenvalues, vectors = np.linalg.eigh(gram)
    eigenvalues = np.maximum(eigenvalues, np.finfo(float).eps * eigenvalues[-1])
    high = (eigenvalues / eigenvalues[-1]) ** power
    low = (eigenvalues[0] / eigenvalues) ** power
    value = np.log(eigenvalues[-1] / eigenvalues[0]) + np.log(high.sum() * low.sum()) / power
    share = (high / high.sum() - low / low.sum()) / eigenvalues
    return CriterionValue(0.5 * float(value), 0.5 * (vectors * share) @ vectors.T)


def log_normalised_condition(gram: np.ndarray, power: float = POWER) -> CriterionValue:
    """The same for Phi with columns of length 1."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    normal = gram * np.outer(scale, scale)
    value, slope = log_condition(normal, power)
    projected = slope - np.diag((slope * normal).sum(axis=1))  # the lengths move with the columns
    return CriterionValue(value, projected * np.outer(scale, scale))


def log_volume(gram: np.ndarray) -> CriterionValue:
    """-log det / 2 p: the log of the mean half axis of the ellipsoid of uncertainty."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    eigenvalues, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    eigenvalues = np.maximum(eigenvalues, np.finfo(float).eps)
    half = 0.5 / len(gram)
    inverse = (vectors / eigenvalues) @ vectors.T * np.outer(scale, scale)
    return CriterionValue(
        half * float(2.0 * np.log(scale).sum() - np.log(eigenvalues).sum()), -half * inverse
    )


def log_std_dev(gram: np.ndarray, plausible: np.ndarray) -> CriterionValue:
    """log of the root mean square of standard deviations relative to plausible values (p,)."""
    relative = gram * np.outer(plausible, plausible)
    eigenvalues, vectors = np.linalg.eigh(relative)
    eigenvalues = np.maximum(eigenvalues, np.finfo(float).eps * eigenvalues[-1])
    variance = (1.0 / eigenvalues).sum()
    slope = -0.5 / variance * (vectors / eigenvalues**2) @ vectors.T
    value = 0.5 * float(np.log(variance / len(gram)))
    return CriterionValue(value, slope * np.outer(plausible, plausible))


class Criterion(NamedTuple):
    """Criterion of some columns, with the information of earlier trajectories.

    `plausible` (c,) are values that standard deviations relate to. The rows of joint i count
    `row_weight[i]` (j,) times; `prior` (p, p) is the sum of the weighted Phi^T Phi of `earlier`
    trajectories of a campaign.

    A trajectory of a campaign is judged by all data with it, and as much by its own: with enough
    earlier trajectories, one on which a joint hardly moves looks nearly as good as any other, and
    identification leaves out data recorded near standstill.
    """

    kind: CriterionKind
    columns: np.ndarray  # (p, c), of `column_map`
    plausible: np.ndarray
    row_weight: np.ndarray
    prior: np.ndarray
    earlier: int = 0

    @classmethod
    def of(
        cls,
        model: Model,
        kind: CriterionKind,
        columns: ColumnSet,
        experiment: PredictedRecording,
        plausible: dict[str, float],
    ) -> "Criterion":
        """The criterion of a single trajectory.

        Raises `ConfigurationError` if a parameter lacks the plausible value A-optimality needs.
        """
        chosen = column_map(model, columns)
        p = len(model.parameters)
        values, weight = np.ones(p), np.ones(len(model.joints))
        if kind in (CriterionKind.D_OPTIMALITY, CriterionKind.A_OPTIMALITY):
            weight = np.array([experiment.noise[joint] for joint in model.joints]) ** -2.0
        if kind is CriterionKind.A_OPTIMALITY:
            names = [parameter.name for parameter in model.parameters]
            lacking = sorted(set(names) - set(plausible))
            if lacking:
                raise ConfigurationError(
                    f"plausible: no value for {', '.join(lacking)}, which {kind} needs; "
                    "give one in the settings"
                )
            values = np.array([plausible[name] for name in names])
        return cls(kind, chosen, np.linalg.pinv(chosen) @ values, weight, np.zeros((p, p)))

    def gram(self, regressor: np.ndarray) -> np.ndarray:
        """Phi^T W Phi (p, p) of a regressor (n, j, p)."""
        stacked = (regressor * np.sqrt(self.row_weight)[:, None]).reshape(-1, regressor.shape[-1])
        return stacked.T @ stacked

    def after(self, regressor: np.ndarray) -> "Criterion":
        """The criterion of the next trajectory, once one with this regressor has been run."""
        return self._replace(prior=self.prior + self.gram(regressor), earlier=self.earlier + 1)

    def evaluate(self, gram: np.ndarray, power: float = POWER) -> CriterionValue:
        """The criterion and its derivative with respect to the `gram` of one more trajectory."""
        together = self._of_all(gram + self.prior, power)
        if not self.earlier:
            return together
        alone, share = self._of_all(gram, power), self.earlier + 1
        return CriterionValue(
            alone.value + share * together.value, alone.slope + share * together.slope
        )

    def _of_all(self, gram: np.ndarray, power: float) -> CriterionValue:
        counted = self.columns.T @ gram @ self.columns
        match self.kind:
            case CriterionKind.RAW:
                value, slope = log_condition(counted, power)
            case CriterionKind.NORMALISED:
                value, slope = log_normalised_condition(counted, power)
            case CriterionKind.PRODUCT:
                raw = log_condition(counted, power)
                normalised = log_normalised_condition(counted, power)
                value, slope = raw.value + normalised.value, raw.slope + normalised.slope
            case CriterionKind.D_OPTIMALITY:
                value, slope = log_volume(counted)
            case CriterionKind.A_OPTIMALITY:
                value, slope = log_std_dev(counted, self.plausible)
        return CriterionValue(value, self.columns @ slope @ self.columns.T)

    def exact(self, gram: np.ndarray) -> float:
        """The criterion without power means: logs of the condition numbers themselves."""
        if self.kind in (CriterionKind.D_OPTIMALITY, CriterionKind.A_OPTIMALITY):
            return self.evaluate(gram).value
        together = self._condition(gram + self.prior)
        if not self.earlier:
            return together
        return self._condition(gram) + (self.earlier + 1) * together

    def _condition(self, gram: np.ndarray) -> float:
        raw, normalised = condition_numbers(self.columns.T @ gram @ self.columns)
        counted = {
            CriterionKind.RAW: raw,
            CriterionKind.NORMALISED: normalised,
            CriterionKind.PRODUCT: raw * normalised,
        }
        return float(np.log(counted[self.kind]))
