"""What an estimator returns."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """Θ with its uncertainty; NaN in place of every parameter that the data do not determine.

    `values`, `std_devs` (p,) and `covariance` (p, p) in `units`. `undetermined` names the
    parameters of which only combinations are seen. `condition_number` is that of Φ in SI units,
    `condition_number_normalized` after scaling each column to norm 1 (inf if rank deficient). Per
    joint (j,), over the used rows: `residual_rms` [N m or N] and `relative_error`, ‖τ - ΦΘ‖/‖τ‖.
    `samples` is the number of rows, `method` how values and standard deviations were obtained.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    joints: tuple[str, ...]
    values: np.ndarray
    std_devs: np.ndarray
    covariance: np.ndarray
    undetermined: tuple[str, ...]
    condition_number: float
    condition_number_normalized: float
    residual_rms: np.ndarray
    relative_error: np.ndarray
    samples: int
    method: str

    @property
    def relative_std_devs(self) -> np.ndarray:
        """Standard deviation over magnitude of each parameter (p,)."""
        return self.std_devs / np.abs(self.values)
