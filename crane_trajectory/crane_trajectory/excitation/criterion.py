"""Criteria of (35): functions of Phi^T Phi that are small where the parameters are determined well.

Condition numbers depend on which columns count and, but for the normalised one, on their units, so
the column set is named. D- and A-optimality do not depend on units; they weigh the rows by the
noise of their joints. In a search power means replace the largest and the smallest eigenvalue:
where the smallest two are equal, as they are at good trajectories, the condition number has no
gradient.
"""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_trajectory.excitation.columns import ColumnSet, column_map
from crane_trajectory.excitation.merit import PredictedRecording, condition_numbers

POWER = 8.0  # of the power means over eigenvalues of Phi^T Phi


class CriterionKind(StrEnum):
    """What is minimised."""

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
    own = slope - np.diag((slope * normal).sum(axis=1))  # the lengths move with the columns
    return CriterionValue(value, own * np.outer(scale, scale))


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
    """What is minimised, of which columns, and what earlier trajectories already tell.

    `plausible` (c,) are values that standard deviations relate to. The rows of joint i count
    `row_weight[i]` (j,) times; `prior` (p, p) is the sum of the weighted Phi^T Phi of `earlier`
    trajectories of a campaign.

    A trajectory of a campaign is judged by all data with it, and as much by its own: together with
    enough earlier ones, one on which a joint hardly moves looks nearly as good as any other, and
    identification leaves out what is recorded near standstill.
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
