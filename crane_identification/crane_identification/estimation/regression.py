"""Rows of (29) from prepared recordings: gated, filtered in parallel, decimated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from crane_identification.preparation.run import Preparation, noise_of_mean
from crane_identification.signals.decimate import (
    UNFILTERED,
    decimate,
    decimation_factor,
    decimation_rows,
    filtered_noise,
    trusted_bandwidth,
)
from crane_model.base_parameters import reveal_rank
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record

RANK_TOLERANCE = 1e-9
CONTAINED = 1e-6  # share of a dependent column's norm above which another is part of it
BALANCE_PASSES = 50
SAME_WEIGHTS = 1e-3  # relative change
LEAST_FREE_ROWS = 1e-3  # rows of a joint that the parameters do not take up
RESIDUAL_ROUNDING = 1e-12  # share of the forces below which a residual is rounding, not noise
LEAST_OPEN_SHARE = 0.5
"""A filtered row is used if at least this share of what the filter saw was let through."""


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
            tuple(deviation for part in parts for deviation in part.scatter),
            first.filtered,
        )

    @property
    def repeated(self) -> bool:
        """Return whether every recording has two periods or more, whose scatter shows the noise."""
        runs = len(np.unique(self.run))
        return len(self.scatter) == runs and all(len(deviation) > 1 for deviation in self.scatter)

    def residual(self, values: np.ndarray) -> np.ndarray:
        """tau - Phi Theta (n, j); 0 where a row is not used."""
        return np.where(self.used, self.force - self.matrix @ values, 0.0)

    def norms(self, forces: np.ndarray) -> np.ndarray:
        """Euclidean norm (j,) of forces (n, j) over the used rows of each joint."""
        return np.sqrt((np.where(self.used, forces, 0.0) ** 2).sum(axis=0))

    def rms(self, forces: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of forces (n, j) over the used rows of each joint."""
        return self.norms(forces) / np.sqrt(np.maximum(self.used.sum(axis=0), 1))


class BasicSolution(NamedTuple):
    """Least squares on the independent columns; the others have the value 0.

    `values` (p,), which of them is `determined` (p,), `bread` (AᵀA)⁻¹ (p, p), zero where dependent,
    and the `condition` number of the columns scaled to norm 1 (inf if rank deficient).
    """

    values: np.ndarray
    determined: np.ndarray
    bread: np.ndarray
    condition: float


def check(rows: Rows) -> None:
    """`DataError` if there are fewer rows than parameters or a row is not finite."""
    parameters = len(rows.names)
    if rows.samples <= parameters:
        raise DataError(
            f"least squares: {rows.samples} rows for {parameters} parameters; record longer, "
            f"decimate less or mask less around reversals"
        )
    bad = rows.used & ~(np.isfinite(rows.force) & np.isfinite(rows.matrix).all(axis=2))
    if bad.any():
        instant, joint = np.argwhere(bad)[0]
        raise DataError(
            f"least squares: joint {rows.joints[joint]} at {rows.time[instant]:.4g} s: force or "
            f"regressor is not finite; cut the recording to where every sensor was logged"
        )


def balancing(rows: Rows) -> np.ndarray:
    """Weights (j,) with which the weighted noise of each joint has standard deviation 1."""
    products = products_of(rows)

    def noise(weights: np.ndarray) -> np.ndarray:
        found = solve_weighted(rows, weights)
        residual = rows.norms(rows.residual(found.values))
        return noise_of_residual(residual, rows.used.sum(axis=0), weights, found.bread, products)

    return balance(len(rows.joints), noise, rows.rms(rows.force))


def products_of(rows: Rows) -> np.ndarray:
    """ΦᵀΦ of the used rows of each joint: (j, p, p)."""
    columns = [rows.matrix[rows.used[:, j], j] for j in range(len(rows.joints))]
    return np.array([matrix.T @ matrix for matrix in columns])


def noise_of_residual(
    norm: np.ndarray,
    rows: np.ndarray,
    weights: np.ndarray,
    bread: np.ndarray,
    products: np.ndarray,
) -> np.ndarray:
    """Standard deviation (j,) of the noise, from the residual `norm` (j,) of each joint.

    The residual sum of squares is divided by the degrees of freedom: the number of `rows` (j,) of
    the joint less the effective number of parameters that it determines, by its ΦᵀΦ among the
    `products` (j, p, p) (Patterson and Thompson 1971). Divided by all its rows
    instead, a joint with few gains weight until the solution passes through them.
    """
    taken = weights**2 * np.einsum("kl,jkl->j", bread, products)
    return np.asarray(norm / np.sqrt(np.maximum(rows - taken, LEAST_FREE_ROWS)))


def solve_weighted(rows: Rows, weights: np.ndarray) -> BasicSolution:
    """The basic solution of the used rows, multiplied by `weights`, (j,) or (n, j)."""
    scaling = np.broadcast_to(weights, rows.force.shape)[rows.used]
    return solve(rows.stacked * scaling[:, None], rows.force[rows.used] * scaling)


def solve(
    matrix: np.ndarray, force: np.ndarray, tolerance: float = RANK_TOLERANCE
) -> BasicSolution:
    """Least squares of weighted rows `matrix` (N, p), `force` (N,) by orthogonal decomposition.

    Columns are scaled to norm 1 inside, so that the units of the parameters do not matter; what is
    within `tolerance` of the others counts as dependent on them.
    """
    basis = reveal_rank(matrix, tolerance)
    kept, dropped = list(basis.independent), list(basis.dependent)
    norms = np.linalg.norm(matrix, axis=0)
    q, r = np.linalg.qr(matrix[:, kept] / norms[kept])
    inverse = np.linalg.solve(r, np.eye(len(kept))) / norms[kept][:, None]
    parameters = matrix.shape[1]
    values, bread = np.zeros(parameters), np.zeros((parameters, parameters))
    values[kept] = inverse @ (q.T @ force)
    bread[np.ix_(kept, kept)] = inverse @ inverse.T
    # A parameter is determined if no dropped column contains its column.
    contained = np.abs(basis.combination) * norms[kept][:, None]
    determined = np.zeros(parameters, dtype=bool)
    determined[kept] = (contained <= CONTAINED * norms[dropped]).all(axis=1)
    return BasicSolution(values, determined, bread, np.inf if dropped else float(np.linalg.cond(r)))


def balance(
    joints: int, noise: Callable[[np.ndarray], np.ndarray], force: np.ndarray
) -> np.ndarray:
    """Weights (j,) with which the weighted noise of each joint has standard deviation 1.

    `noise` gives the standard deviation (j,) of the noise by the solution with given weights; a
    single joint needs no weight. Of residuals that are rounding beside the `force` (j,), root mean
    square, none counts more than another.
    """
    weights = np.ones(joints)
    floor = np.where(force > 0.0, RESIDUAL_ROUNDING * force, 1.0)
    for _ in range(BALANCE_PASSES if joints > 1 else 0):
        before, weights = weights, 1.0 / np.maximum(noise(weights), floor)
        if (np.abs(np.log(weights / before)) < SAME_WEIGHTS).all():
            break
    return weights


def common_factor(preparations: Sequence[Preparation], given: int | None = None) -> int:
    """The decimation factor that the least known motion of all allows, or the `given` one.

    `DataError` naming a recording in which no joint moves.
    """
    if given is not None:
        return given
    return min(_factor(preparation) for preparation in preparations)


def _factor(preparation: Preparation) -> int:
    try:
        bandwidth = trusted_bandwidth(preparation.bandwidth, preparation.moving)
    except DataError as error:
        raise DataError(f"{preparation.source}: {error}") from None
    return decimation_factor(bandwidth, preparation.step)


def build_rows(model: Model, preparation: Preparation, factor: int) -> Rows:
    """Φ and τ of one recording, both through the same zero-phase filter and decimation.

    Both sides are first set to 0 where the sign of the joint's velocity is not known, which keeps
    (28) exact and keeps the filter from spreading the errors made there; rows that are mostly
    empty are not used.
    """
    record = preparation.record
    assert record.force is not None  # prepare() refuses such recordings
    gate = preparation.moving.astype(float)
    matrix = _columns(model, preparation, record, factor)
    deviation = (preparation.periods - preparation.periods.mean(axis=0)) * preparation.moving
    scatter = np.stack([decimate(period, factor, preparation.periodic) for period in deviation])
    kept = decimation_rows(len(gate), factor)
    return Rows(
        joints=model.joints,
        names=tuple(parameter.name for parameter in model.parameters),
        units=tuple(parameter.unit for parameter in model.parameters),
        time=record.time[kept],
        run=np.zeros(len(kept), dtype=int),
        matrix=matrix,
        force=decimate(record.force * gate, factor, preparation.periodic),
        used=decimate(gate, factor, preparation.periodic) > LEAST_OPEN_SHARE,
        scatter=(scatter,),
        filtered=filtered_noise(factor),
    )


def instruments(model: Model, preparation: Preparation, factor: int) -> np.ndarray:
    """Φ (n, j, p) along the reference, gated and filtered as the rows of the same recording.

    `DataError` where the reference was not recorded.
    """
    if preparation.reference is None:
        raise DataError(
            f"{preparation.source}: instrumental variables need the reference position, velocity "
            f"and acceleration (/joint_reference); record it, or choose another estimator"
        )
    return _columns(model, preparation, preparation.reference, factor)


def _columns(model: Model, preparation: Preparation, record: Record, factor: int) -> np.ndarray:
    gate = preparation.moving[:, :, np.newaxis]
    return decimate(model.regressor(record) * gate, factor, preparation.periodic)


def noise_floor(preparation: Preparation, factor: int) -> np.ndarray:
    """Root mean square noise (j,) [N m or N] of the filtered, averaged generalized force.

    From the scatter between periods, so free of any model; NaN without two periods.
    """
    periods = np.stack(
        [decimate(period, factor, preparation.periodic) for period in preparation.periods]
    )
    return noise_of_mean(periods, np.ones(periods.shape[1:], dtype=bool))


@dataclass(frozen=True)
class Estimate:
    """Estimated parameters Θ with their uncertainty.

    Parameters
    ----------
    names, units : tuple of str
        Names and units of the p parameters.
    joints : tuple of str
        Names of the j joints.
    values, std_devs : ndarray, shape (p,)
        Estimates and standard deviations in `units`; NaN if not determined.
    covariance : ndarray, shape (p, p)
        Covariance of the estimates.
    undetermined : tuple of str
        Parameters of which only combinations are seen, or nothing beyond the noise.
    condition_number, condition_number_normalized : float
        Condition number of Φ in SI units, and with each column scaled to norm 1.
    residual_rms : ndarray, shape (j,)
        Root mean square residual of the used rows [N m or N].
    relative_error : ndarray, shape (j,)
        ‖τ - ΦΘ‖/‖τ‖ over the used rows.
    samples : int
        Number of used rows.
    method : str
        How values and standard deviations were obtained.
    bounds : tuple of str
        Physical constraints that hold the values back.
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
