"""What every estimator returns."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.estimation.regression import Rows


@dataclass(frozen=True)
class Estimate:
    """Θ with its uncertainty; NaN in place of every parameter that the data do not determine.

    `values`, `std_devs` (p,) and `covariance` (p, p) in `units`. `undetermined` names the
    parameters of which only combinations are seen, or nothing beyond the noise.
    `condition_number` is that of Φ in SI units, `condition_number_normalized` after scaling each
    column to norm 1 (inf if rank deficient). Per joint (j,), over the used rows: `residual_rms`
    [N m or N] and `relative_error`, ‖τ - ΦΘ‖/‖τ‖. `samples` is the number of rows, `method` how
    values and standard deviations were obtained, `bounds` the physical constraints that hold the
    values back.
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
    bounds: tuple[str, ...] = ()

    @property
    def relative_std_devs(self) -> np.ndarray:
        """Standard deviation over magnitude of each parameter (p,)."""
        with np.errstate(divide="ignore"):  # of a value that rests on its bound, 0
            return self.std_devs / np.abs(self.values)


class Fit(NamedTuple):
    """`values` (p,), their `covariance` (p, p), and which of them are `determined` (p,).

    `beforehand` are the rows of a prior as they stand under the weighted rows: (k, p), (k,).
    """

    values: np.ndarray
    covariance: np.ndarray
    determined: np.ndarray
    beforehand: tuple[np.ndarray, np.ndarray] | None = None


def describe(rows: Rows, fit: Fit, method: str, bounds: tuple[str, ...] = ()) -> Estimate:
    """The estimate that `fit` makes on `rows` as they were measured."""
    values, spread, determined, _ = fit
    residual = rows.residual(values)
    raw, normalized = condition_numbers(rows.stacked)
    spread = np.where(determined[:, None] & determined, spread, np.nan)
    return Estimate(
        names=rows.names,
        units=rows.units,
        joints=rows.joints,
        values=np.where(determined, values, np.nan),
        std_devs=np.sqrt(np.diag(spread)),
        covariance=spread,
        undetermined=tuple(np.array(rows.names)[~determined].tolist()),
        condition_number=raw,
        condition_number_normalized=normalized,
        residual_rms=rows.rms(residual),
        relative_error=relative(rows.norms(residual), rows.norms(rows.force)),
        samples=rows.samples,
        method=method,
        bounds=bounds,
    )


def condition_numbers(stacked: np.ndarray) -> tuple[float, float]:
    """Condition number of columns (N, p) as they are, and with each scaled to norm 1."""
    norms = np.linalg.norm(stacked, axis=0)
    if not norms.all():
        return np.inf, np.inf
    return float(np.linalg.cond(stacked)), float(np.linalg.cond(stacked / norms))


def relative(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """part / whole, NaN where there is nothing to compare with."""
    return np.divide(part, whole, out=np.full_like(whole, np.nan), where=whole > 0)
