"""Least-squares estimators: ordinary, weighted, instrumental and robust, and their covariance."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert, matmul_toeplitz, solve_triangular
from scipy.stats import norm as normal
from scipy.stats import t as student

from crane_identification.estimation.autoregression import (
    Autoregression,
    LackOfFit,
    autocovariances,
    lack_of_fit,
    restricted_likelihood,
)
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import (
    Estimate,
    Fit,
    Rows,
    balance,
    balancing,
    check,
    describe,
    noise_of_residual,
    products_of,
    solve,
    solve_weighted,
)
from crane_identification.options import Covariance
from crane_model.base_parameters import reveal_rank
from crane_model.errors import DataError

LEAST_NOISE_PROBABILITY = 0.01
"""Probability of noise leaving such a residual, above which it is taken for noise."""

COVERED_QUANTILE = 0.975  # below the upper end of an interval of two standard deviations
UNSEEN_FORCE_SHARE = 1.0
"""A parameter is not determined if one standard deviation of it changes the force, on some joint,
by as much as the whole measured force."""
HUBER, BISQUARE = 1.345, 4.685  # standard deviations
NORMAL = 1.4826  # standard deviation over median absolute deviation of normal noise
ROBUST_PASSES = 100
SAME_RESIDUAL = 1e-6  # change of the residuals, in scales


def white(residual: np.ndarray, bread: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Covariance (p, p) of the estimate for a white weighted residual (N,).

    `bread` is (ΦᵀW²Φ)⁻¹.
    """
    if assumption is Covariance.SAMPLE:
        return bread * np.var(residual, ddof=1)
    return bread * (residual @ residual) / (len(residual) - len(bread))


class NoiseOfJoint(NamedTuple):
    """Effect of one joint's noise on the estimate.

    `meat` (p, p) is ΦᵀW Γ WΦ of its rows, Γ the autocovariance of the noise, and `freedom` the
    number of independent samples that Γ rests on. `likely` (p, p) is the same by the most probable
    model of the noise, without caution.
    """

    meat: np.ndarray
    likely: np.ndarray
    freedom: float


def meat(rows: Rows, weights: np.ndarray, values: np.ndarray, assumption: Covariance) -> np.ndarray:
    """Σ ΦᵀW Γ WΦ (p, p), with Γ the autocovariance of the noise that `assumption` gives."""
    spread = np.broadcast_to(weights, rows.force.shape)
    residual = spread * rows.residual(values)
    if assumption is Covariance.CORRELATED:
        joints = noise_of_joints(rows, spread, residual, lack_of_fit(rows, values))
        return np.sum([noise.meat for noise in joints], axis=0)
    columns = rows.stacked * spread[rows.used][:, None]
    unit = np.eye(len(values))
    return columns.T @ columns * white(residual[rows.used], unit, assumption)[0, 0]


def correlated(joints: Sequence[NoiseOfJoint], bread: np.ndarray) -> np.ndarray:
    """Covariance B (Σ meat) B (p, p), widened as the noise is known from few samples.

    Two standard deviations hold the truth in 95 % of all cases: by Student's t, with the degrees of
    freedom of each parameter from those of the joints that its variance comes from (Satterthwaite
    1946).
    """
    parts = np.array([bread @ noise.meat @ bread for noise in joints])
    variances = np.diagonal(parts, axis1=1, axis2=2)
    covariance, total = parts.sum(axis=0), variances.sum(axis=0)
    freedom = np.array([noise.freedom for noise in joints])
    uncertain = (variances**2 / freedom[:, np.newaxis]).sum(axis=0)
    known = np.divide(total**2, uncertain, out=np.full_like(total, np.inf), where=uncertain > 0.0)
    wider = student.ppf(COVERED_QUANTILE, known) / normal.ppf(COVERED_QUANTILE)
    widened: np.ndarray = covariance * wider * wider[:, np.newaxis]
    return widened


def noise_of_joints(
    rows: Rows, weights: np.ndarray, residual: np.ndarray, left: LackOfFit
) -> list[NoiseOfJoint]:
    """The noise of each joint that has used rows.

    Where the residual is noise, as the test of lack of fit sees it, its autocovariance is that of
    an autoregressive model of the scatter between periods before the parallel filter: what the
    filter does to noise is known, and found anew from fifty rows it would make standard deviations
    a matter of chance. Its variance is that of scatter and residual together. Else it is found from
    the rows of the joint alone, cautiously, and scaled up where the weighted `residual` (n, j) is
    larger: then the joints contradict each other. On records of a hundred rows such intervals cover
    what they claim, where those of a kernel estimate (Newey and West) are up to twice too narrow.
    """
    runs = [np.flatnonzero(rows.run == run) for run in np.unique(rows.run)]
    lags = max(len(run) for run in runs)
    found = []
    for j in range(len(rows.joints)):
        used = rows.used[:, j]
        if not used.any():
            continue
        weight = np.where(used, weights[:, j], 0.0)
        columns, force = rows.matrix[:, j] * weight[:, None], rows.force[:, j] * weight
        noise = _shown_by_scatter(rows, weight, left, j)
        if noise is not None:
            covariance = likely = noise.autocovariance(lags)
            freedom = float(left.freedom[j] + left.noise_freedom[j])
        else:
            independent = list(reveal_rank(columns[used]).independent)
            regression = (
                _by_run(columns[:, independent], runs),
                _by_run(force, runs),
                _by_run(used, runs),
            )
            power = float((residual[used, j] ** 2).mean())
            likely, covariance = (
                known * max(1.0, power / known[0]) if known[0] > 0.0 else known
                for known in autocovariances(*regression, lags, power)
            )
            free = 1.0 - len(independent) / int(used.sum())
            freedom = free * _independent(covariance, [int(used[run].sum()) for run in runs])
        cautious, probable = (
            np.sum(
                [
                    columns[r].T @ matmul_toeplitz(autocovariance[: len(r)], columns[r])
                    for r in runs
                ],
                axis=0,
            )
            for autocovariance in (covariance, likely)
        )
        found.append(NoiseOfJoint(cautious, probable, max(freedom, 1.0)))
    return found


def _independent(covariance: np.ndarray, samples: Sequence[int]) -> float:
    """How many of runs of so many samples are independent: tr(C)²/tr(C²) of their covariance C."""
    if not covariance[0] > 0.0:
        return float(sum(samples))
    squares = (covariance / covariance[0]) ** 2
    total = 0.0
    for count in samples:
        lags = np.arange(1, count)
        total += count + 2.0 * float(((count - lags) * squares[1:count]).sum())
    return sum(samples) ** 2 / total


def _shown_by_scatter(
    rows: Rows, weight: np.ndarray, left: LackOfFit, j: int
) -> Autoregression | None:
    """The noise of the weighted mean force of joint j; None if the residual is not that noise."""
    if not left.p_value[j] > LEAST_NOISE_PROBABILITY:
        return None
    longest = max(deviation.shape[1] for deviation in rows.scatter)
    deviations, used = [], []
    for run, deviation in enumerate(rows.scatter):
        in_run = rows.run == run
        padding = (0, longest - deviation.shape[1])
        # The deviations of M periods hold M - 1 independent ones, each of the variance of a period.
        contrasts = helmert(len(deviation)) @ deviation[:, :, j] / np.sqrt(len(deviation))
        deviations.append(np.pad(contrasts * weight[in_run], ((0, 0), padding)))
        used.append(np.tile(np.pad(rows.used[in_run, j], padding), (len(contrasts), 1)))
    force, known = np.concatenate(deviations), np.concatenate(used)
    noise = restricted_likelihood(np.zeros((*force.shape, 0)), force, known, rows.filtered)
    if noise is None:
        return None
    freedom, of_noise = left.freedom[j], left.noise_freedom[j]
    pooled = (of_noise + freedom * left.ratio[j]) / (of_noise + freedom)
    return noise._replace(variance=noise.variance * float(pooled))


def _by_run(values: np.ndarray, runs: list[np.ndarray]) -> np.ndarray:
    """(n, ...) to (runs, longest run, ...), padded with zeros."""
    longest = max(len(run) for run in runs)
    out = np.zeros((len(runs), longest, *values.shape[1:]), dtype=values.dtype)
    for i, run in enumerate(runs):
        out[i, : len(run)] = values[run]
    return out


# Least squares (30)-(31) by orthogonal decomposition, with weights, rank check and uncertainty.


def least_squares(
    rows: Rows,
    covariance: Covariance = Covariance.CORRELATED,
    weights: np.ndarray | None = None,
    prior: Prior | None = None,
) -> Estimate:
    """Θ that minimises the weighted norm of τ - ΦΘ (30).

    `weights` multiply the rows: (j,) or (n, j), in 1/N m and 1/N. Without them, one joint is
    fitted as (31) stands; with several, each is weighted by the inverse of the standard deviation
    of its noise, in passes from equal weights until they stay the same. A `prior` counts beside
    them.

    Raises `DataError` if there are fewer rows than parameters or a row is not finite.
    """
    check(rows)
    weights = balancing(rows) if weights is None else weights
    found = fit(rows, weights, covariance, prior)
    method = f"least squares (31){' with a prior' if prior else ''}, {covariance} residual"
    return describe(rows, found, method)


class Spread(NamedTuple):
    """`covariance` (p, p) of an estimate, and that by the most `likely` noise, taken for certain.

    The likely one weighs a prior and tells what is seen at all; the other is reported.
    """

    covariance: np.ndarray
    likely: np.ndarray


def fit(rows: Rows, weights: np.ndarray, covariance: Covariance, prior: Prior | None = None) -> Fit:
    """Θ and its covariance for given weights, (j,) or (n, j), and a prior."""
    weights = np.broadcast_to(weights, rows.force.shape)
    values, determined, bread, _ = solve_weighted(rows, weights)
    spread = spread_of(rows, weights, values, bread, covariance)
    if prior is None:
        return Fit(values, spread.covariance, determined & _seen(rows, spread.likely))
    scaling = weights[rows.used]
    matrix, force = rows.stacked * scaling[:, None], rows.force[rows.used] * scaling
    # Noise that is correlated from row to row makes rows count for fewer than they are.
    rank = np.count_nonzero(np.diag(bread))
    excess = float(np.trace(spread.likely @ (matrix.T @ matrix))) / rank
    beforehand = prior.matrix * np.sqrt(excess), prior.values * np.sqrt(excess)
    values, determined, bread, _ = solve(
        np.vstack([matrix, beforehand[0]]), np.concatenate([force, beforehand[1]])
    )
    carried = bread @ beforehand[0].T
    of_prior = excess * carried @ carried.T
    spread = spread_of(rows, weights, values, bread, covariance)
    seen = determined & _seen(rows, spread.likely + of_prior)
    return Fit(values, spread.covariance + of_prior, seen, beforehand)


def spread_of(
    rows: Rows, weights: np.ndarray, values: np.ndarray, bread: np.ndarray, covariance: Covariance
) -> Spread:
    """Covariance that the noise of the rows gives the solution with this `bread`."""
    residual = weights * rows.residual(values)
    if covariance is Covariance.CORRELATED:
        joints = noise_of_joints(rows, weights, residual, lack_of_fit(rows, values))
        likely = bread @ np.sum([noise.likely for noise in joints], axis=0) @ bread
        return Spread(correlated(joints, bread), likely)
    found = white(residual[rows.used], bread, covariance)
    return Spread(found, found)


def _seen(rows: Rows, covariance: np.ndarray) -> np.ndarray:
    """(p,): whether the force says more about a parameter than that it is there."""
    std_devs = np.sqrt(np.diag(covariance))
    columns = np.stack([rows.rms(rows.matrix[:, :, k]) for k in range(len(rows.names))])
    force = rows.rms(rows.force)
    hidden = (columns * std_devs[:, None] > UNSEEN_FORCE_SHARE * force) & (columns > 0.0)
    return np.asarray(~hidden.any(axis=1))


# Least squares weighted by the covariance of the noise between joints (generalized, Aitken).


def weighted(rows: Rows, covariance: Covariance = Covariance.CORRELATED) -> Estimate:
    """Θ that minimises Σ rᵀ C⁻¹ r over all instants, r = τ - ΦΘ of the joints used there.

    C (j, j) of each recording comes from the scatter of its periods, so that no model has to be
    fitted first. `DataError` where no period was repeated, and as `least_squares`.
    """
    check(rows)
    if not rows.repeated:
        raise DataError(
            "weights: the noise between joints is the scatter between periods, and a recording has "
            "one period only; record at least two, average, or choose another estimator"
        )
    method = f"least squares weighted by the noise between joints, {covariance} residual"
    return describe(rows, fit(whiten(rows), np.ones(len(rows.joints)), covariance), method)


def noise_between_joints(rows: Rows, run: int) -> np.ndarray:
    """Covariance (j, j) of the noise of the mean force of a recording, over its used rows."""
    used, deviation = rows.used[rows.run == run], rows.scatter[run]
    count = len(deviation)
    masked = np.where(used, deviation, 0.0)
    power = np.einsum("mnj,mnk->jk", masked, masked) / (count - 1) / count
    both = used.T.astype(float) @ used
    return np.where(both > 0, power / np.maximum(both, 1), 0.0)


def whiten(rows: Rows) -> Rows:
    """Rows whose noise has unit variance and is independent between joints.

    Those used at an instant are multiplied by L⁻¹, with L Lᵀ = C of these joints alone.
    """
    matrix, force = np.zeros_like(rows.matrix), np.zeros_like(rows.force)
    scatter = []
    for run, deviation in enumerate(rows.scatter):
        covariance, instants = noise_between_joints(rows, run), np.flatnonzero(rows.run == run)
        whitened = np.zeros_like(deviation)
        for pattern in np.unique(rows.used[instants], axis=0):
            joints = np.flatnonzero(pattern)
            within = np.flatnonzero((rows.used[instants] == pattern).all(axis=1))
            root = _root(covariance[np.ix_(joints, joints)], run)
            inverse = solve_triangular(root, np.eye(len(joints)), lower=True)
            cells = np.ix_(instants[within], joints)
            matrix[cells] = np.einsum("ij,njp->nip", inverse, rows.matrix[cells])
            force[cells] = rows.force[cells] @ inverse.T
            every = np.arange(len(deviation))
            whitened[np.ix_(every, within, joints)] = (
                deviation[np.ix_(every, within, joints)] @ inverse.T
            )
        scatter.append(whitened)
    return replace(rows, matrix=matrix, force=force, scatter=tuple(scatter))


def _root(covariance: np.ndarray, run: int) -> np.ndarray:
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise DataError(
            f"weights: the noise covariance of recording {run + 1} is not positive definite; the "
            f"forces of its periods must differ; or choose another estimator"
        ) from None


# Instrumental variables: consistent where feedback lets the noise into the regressor.
#
# A force that the model does not know moves the joint; the controller (36) answers, and so the
# measured motion, Φ, is correlated with the noise of (28): least squares is biased, however long
# the recording. The motion that was asked for is not: Z is the regressor along the reference.


def instrumental(
    rows: Rows, instruments: np.ndarray, covariance: Covariance = Covariance.CORRELATED
) -> Estimate:
    """Θ for which the residual is orthogonal to the instruments: Zᵀ W² (τ - ΦΘ) = 0.

    `instruments` (n, j, p): Φ along a motion free of noise. The joints are balanced as in
    `least_squares`. With Φ̂ the projection of Φ on Z, least squares of Φ̂Θ + (τ - ΦΘ) on Φ̂ has the
    same solution and its covariance. `DataError` as `least_squares`.
    """
    check(rows)
    joints = len(rows.joints)

    def projected(weights: np.ndarray) -> Rows:
        scaling = np.broadcast_to(weights, rows.force.shape)[rows.used][:, None]
        basis = np.linalg.qr(instruments[rows.used] * scaling)[0]
        matrix = np.zeros_like(rows.matrix)
        matrix[rows.used] = basis @ (basis.T @ (rows.stacked * scaling)) / scaling
        return replace(rows, matrix=matrix)

    def noise(weights: np.ndarray) -> np.ndarray:
        seen = projected(weights)
        found = solve_weighted(seen, weights)
        norm, count = rows.norms(rows.residual(found.values)), rows.used.sum(axis=0)
        return noise_of_residual(norm, count, weights, found.bread, products_of(seen))

    weights = balance(joints, noise, rows.rms(rows.force))
    seen = projected(weights)
    theta = solve_weighted(seen, weights).values
    pseudo = replace(seen, force=seen.matrix @ theta + rows.residual(theta))
    method = f"instrumental variables (reference), {covariance} residual"
    return describe(rows, fit(pseudo, weights, covariance), method)


# Robust regression: iteratively reweighted least squares that outliers cannot steer.
#
# Tukey's bisquare (Beaton and Tukey 1974) from a start by Huber's loss, which has one minimum only;
# both with the usual constants, 95 % efficient on normal noise.


Loss = Callable[[np.ndarray], np.ndarray]
"""Weight ψ(u)/u of residuals u, counted in scales."""


def huber(u: np.ndarray) -> np.ndarray:
    """min(1, k/|u|): large residuals pull with constant force."""
    return HUBER / np.maximum(np.abs(u), HUBER)


def bisquare(u: np.ndarray) -> np.ndarray:
    """(1 - (u/k)²)², 0 beyond k: gross errors do not pull at all."""
    return np.clip(1.0 - (u / BISQUARE) ** 2, 0.0, None) ** 2


def robust(rows: Rows, covariance: Covariance = Covariance.CORRELATED) -> Estimate:
    """Θ that minimises the bisquare loss of the residuals, each joint counted in its own scale.

    With Huber's pseudo-values, ΦΘ + s ψ(r/s)/m where m is the mean of ψ', least squares gives the
    same Θ and its asymptotic covariance, correlated or not. `DataError` as `least_squares`.
    """
    check(rows)
    values = solve_weighted(rows, balancing(rows)).values
    scale = _scale(rows, values)
    for loss in (huber, bisquare):
        values, scale = _reweighted(rows, loss, scale)
    u = rows.residual(values) / scale
    slope = np.where(rows.used, _slope(u), 0.0).sum(axis=0) / np.maximum(rows.used.sum(axis=0), 1)
    pseudo = rows.matrix @ values + scale * bisquare(u) * u / slope
    found = fit(replace(rows, force=pseudo, scatter=()), np.sqrt(slope) / scale, covariance)
    rejected = int((rows.used & (np.abs(u) > BISQUARE)).sum())
    method = f"robust regression (bisquare), {rejected} rows rejected, {covariance} residual"
    return describe(rows, found, method)


def _reweighted(rows: Rows, loss: Loss, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Θ and the scale (j,) of the residuals, repeated until neither moves."""
    u = np.zeros_like(rows.force)
    for _ in range(ROBUST_PASSES):
        before = u
        values = solve_weighted(rows, np.sqrt(loss(u)) / scale).values
        u = rows.residual(values) / scale
        if np.abs(u - before).max() < SAME_RESIDUAL:
            break
        scale = _scale(rows, values)
    return values, scale


def _scale(rows: Rows, values: np.ndarray) -> np.ndarray:
    """Standard deviation (j,) of the residuals that normal noise of their median size has."""
    residual = np.where(rows.used, np.abs(rows.residual(values)), np.nan)
    size = NORMAL * np.nanmedian(residual, axis=0)
    return np.maximum(np.nan_to_num(size, nan=1.0), np.finfo(float).tiny ** 0.25)


def _slope(u: np.ndarray) -> np.ndarray:
    """ψ' of the bisquare."""
    inside = 1.0 - (u / BISQUARE) ** 2
    return np.where(inside > 0.0, inside * (1.0 - 5.0 * (u / BISQUARE) ** 2), 0.0)
