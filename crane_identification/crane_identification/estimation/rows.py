"""The overdetermined system (29): stacked rows of regressor columns and generalized force."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from crane_identification.signals.decimate import UNFILTERED
from crane_model.errors import DataError


@dataclass(frozen=True)
class Rows:
    """n instants of j joints and p parameters, in time order within each run.

    `matrix` (n, j, p), `force` (n, j) [N m or N], `used` (n, j): False where a row tells nothing
    (it is left out, and keeps its place in time); `run` (n,) numbers the recordings; `time` (n,)
    [s]. Where the force is a mean over periods, `scatter` holds, per recording, the deviations
    (periods, its rows, j) of each period from it. `filtered` (lags,): autocorrelation that the
    parallel filter gives to white noise.
    """

    joints: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    time: np.ndarray
    run: np.ndarray
    matrix: np.ndarray
    force: np.ndarray
    used: np.ndarray
    scatter: tuple[np.ndarray, ...] = ()
    filtered: np.ndarray = field(default_factory=lambda: UNFILTERED)

    def __post_init__(self) -> None:
        n, joints = self.force.shape
        if self.matrix.shape != (n, joints, len(self.names)) or self.used.shape != (n, joints):
            raise DataError(
                f"rows: columns have shape {self.matrix.shape} and the mask {self.used.shape}; "
                f"the forces {self.force.shape} and {len(self.names)} parameters need "
                f"{(n, joints, len(self.names))} and {(n, joints)}"
            )

    @property
    def stacked(self) -> np.ndarray:
        """Phi of (29), used rows only: (N, p)."""
        return self.matrix[self.used]

    @property
    def samples(self) -> int:
        """Number N of used rows."""
        return int(self.used.sum())

    @classmethod
    def stack(cls, parts: Sequence[Self]) -> Self:
        """All recordings under each other, numbered in their order."""
        first = parts[0]
        for part in parts[1:]:
            if (part.joints, part.names, part.units) != (first.joints, first.names, first.units):
                raise DataError("rows of different models or joints cannot be stacked")
        return cls(
            first.joints,
            first.names,
            first.units,
            np.concatenate([part.time for part in parts]),
            np.concatenate([np.full(len(part.time), i) for i, part in enumerate(parts)]),
            np.concatenate([part.matrix for part in parts]),
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.used for part in parts]),
            tuple(one for part in parts for one in part.scatter),
            first.filtered,
        )

    @property
    def repeated(self) -> bool:
        """Whether every recording has at least two periods, whose scatter shows the noise."""
        runs = len(np.unique(self.run))
        return len(self.scatter) == runs and all(len(one) > 1 for one in self.scatter)

    def residual(self, values: np.ndarray) -> np.ndarray:
        """tau - Phi Theta (n, j); 0 where a row is not used."""
        return np.where(self.used, self.force - self.matrix @ values, 0.0)

    def norms(self, forces: np.ndarray) -> np.ndarray:
        """Euclidean norm (j,) of forces (n, j) over the used rows of each joint."""
        return np.sqrt((np.where(self.used, forces, 0.0) ** 2).sum(axis=0))

    def rms(self, forces: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of forces (n, j) over the used rows of each joint."""
        return self.norms(forces) / np.sqrt(np.maximum(self.used.sum(axis=0), 1))
