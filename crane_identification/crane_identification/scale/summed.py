"""The fit that information matrices of recordings add up to, in two rounds over the recordings.

The first sums the information, which gives the same Θ as all rows in one place; the second the
covariance: there the noise of each recording is judged by itself, so that the standard deviations
are close to, and not the same as, those of all rows in one place.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Self

import numpy as np

from crane_identification.estimation.excitation import at_one_speed, undetermined_in_words
from crane_identification.estimation.rows import BasicSolution
from crane_identification.scale.information import Information
from crane_model.errors import DataError
from crane_model.model_file import Model


@dataclass(frozen=True)
class SummedFit:
    """The `model` with its values, from the `information` of all recordings, and the `suspicions`
    about them.
    """

    model: Model
    information: Information
    suspicions: tuple[str, ...]
    workers: int = 1


@dataclass(frozen=True)
class FirstRound:
    """After the first round: the `information` of so many `recordings`, `weights` (j,) that balance
    the joints, and the `solution`.
    """

    information: Information
    recordings: int
    weights: np.ndarray
    solution: BasicSolution

    @classmethod
    def of(cls, model: Model, parts: list[Information]) -> Self:
        """Raises `DataError` if the recordings do not determine the model."""
        information = reduce(add, parts)
        if information.rows.sum() <= len(information.names):
            raise DataError(
                f"least squares: {information.rows.sum()} rows for {len(information.names)} "
                "parameters; record longer"
            )
        weights = information.balancing()
        solution = information.solve(weights)
        names, count = np.array(information.names), len(information.names)
        pairs = at_one_speed(model, information.matrix[:, :count, :count]).values()
        unknown = names[~solution.determined | np.isin(names, [n for pair in pairs for n in pair])]
        if len(unknown):
            raise DataError(undetermined_in_words(model, unknown.tolist()))
        return cls(information, len(parts), weights, solution)

    def fitted(self, model: Model, meat: np.ndarray) -> Model:
        """With Θ, and standard deviations of the `meat` (p, p) that the second round sums."""
        covariance = self.solution.bread @ meat @ self.solution.bread
        return model.with_estimate(
            self.solution.values,
            np.sqrt(np.diag(covariance)),
            f"least squares (31) from the information of {self.recordings} recordings, "
            f"{self.information.rows.sum()} rows",
        )
