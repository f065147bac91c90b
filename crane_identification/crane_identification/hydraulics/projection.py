"""Least squares of the balance: the spool outside, gains and oil inside (variable projection).

Rows of the two chambers share the noise of the encoder and little else, so that they are whitened
by its covariance, which is estimated from what is left; the covariance of the estimate is that of
rows which are correlated over blocks of time, whatever their law.

Sources: Golub and Pereyra, Inverse Problems 19 (2003) R1; Liang and Zeger, Biometrika 73 (1986);
Bell and McCaffrey, Survey Methodology 28 (2002).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import f as fisher
from scipy.stats import norm as normal
from scipy.stats import t as student

from crane_identification.data.log import Log
from crane_identification.estimation.autoregression import independent_samples
from crane_identification.hydraulics.balance import (
    ROW_RATE,
    AnyRows,
    Balance,
    ChamberRows,
    SpoolValues,
)
from crane_identification.preparation.periodicity import Periodicity, periodic_part
from crane_model.errors import DataError

LOWEST_SPOOL = SpoolValues(1e-3, 0.0, 0.0, 0.0, 0.0)
HIGHEST_SPOOL = SpoolValues(0.8, 1.5, 0.5, 0.5, 0.3)
SCALE = np.array([2e-3, 0.1, 1e-2, 1e-2, 1e-2])
"""Scales of the parameters of a spool, so that a step of 1 changes the balance visibly."""
SPOOL_STEP = 1e-3  # of SCALE, for derivatives
STARTS = (
    *product((0.01, 0.03, 0.08), (0.005, 0.02, 0.04, 0.06, 0.09, 0.13, 0.2)),
    *product((0.16, 0.24, 0.32, 0.45), (0.02, 0.06, 0.13)),
)
"""Lags [s] and dead bands that are tried before the search: servo, then pilot-operated valves."""
# Steps of the search at most, which takes five where the flow follows the valve
MOST_SEARCH_STEPS = 30
WHITENING_ROUNDS = 3  # of the whitening
FLOW_ROUNDING_SHARE = 1e-12  # of the flow's power: what is left of data without noise
CORRELATED_BLOCK_S = 2.0  # s over which rows may be correlated
INTERVAL = 0.95  # what a normal interval of a standard deviation is to cover
LEAST_FREE_BLOCKS = 3.0  # of blocks: fewer tell no standard deviation
SHIFTS = 16  # of the encoder, within a count


@dataclass(frozen=True)
class BalanceFit:
    """Spool and k linear parameters, their joint covariance (5 + k, 5 + k), what is left (N, c).

    `whitening` (c, c) makes the c flows of a row independent and their power 1.
    """

    spool: SpoolValues
    linear: np.ndarray
    covariance: np.ndarray
    left: np.ndarray
    whitening: np.ndarray
    unexplained: float  # rms share of the flow


def project(balance: Balance[AnyRows]) -> BalanceFit:
    """The best spool, gains and oil."""
    whitening = np.diag(1.0 / np.sqrt((balance.flow**2).mean(axis=0)))
    spool = _started(balance, whitening)
    for _ in range(WHITENING_ROUNDS):
        spool = _searched(balance, whitening, spool)
        linear = _solved(balance, whitening, spool)[0]
        left = balance.flow - balance.columns(spool) @ linear
        noise = left.T @ left / len(left) + FLOW_ROUNDING_SHARE * np.diag(
            (balance.flow**2).mean(axis=0)
        )
        whitening = np.linalg.inv(np.linalg.cholesky(noise))
    covariance = _covariance(balance, whitening, spool, linear, left)
    share = float(np.sqrt((left**2).sum() / (balance.flow**2).sum()))
    return BalanceFit(spool, linear, covariance, left, whitening, share)


def _started(balance: Balance[AnyRows], whitening: np.ndarray) -> SpoolValues:
    tried = [
        LOWEST_SPOOL._replace(lag=lag, share=0.5, dead_band_a=d, dead_band_b=d) for lag, d in STARTS
    ]
    return min(tried, key=lambda spool: (_rest(balance, whitening, spool) ** 2).sum())


def _searched(balance: Balance[AnyRows], whitening: np.ndarray, start: SpoolValues) -> SpoolValues:
    low, high = np.array(LOWEST_SPOOL) / SCALE, np.array(HIGHEST_SPOOL) / SCALE
    found = least_squares(
        lambda x: _rest(balance, whitening, _spool(x)),
        np.clip(np.array(start) / SCALE, low + SPOOL_STEP, high - SPOOL_STEP),
        bounds=(low, high),
        diff_step=SPOOL_STEP,
        xtol=1e-7,
        ftol=1e-6,
        max_nfev=MOST_SEARCH_STEPS,
    )
    return _spool(found.x)


def _spool(x: np.ndarray) -> SpoolValues:
    return SpoolValues(*(SCALE * x).tolist())


def _whitened(whitening: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(c N, k) from (N, c, k)."""
    out: np.ndarray = np.einsum("ab,nbk->nak", whitening, columns)
    return out.reshape(-1, columns.shape[2])


def _solved(
    balance: Balance[AnyRows], whitening: np.ndarray, spool: SpoolValues
) -> tuple[np.ndarray, np.ndarray]:
    """Linear parameters (k,), and the whitened columns (c N, k)."""
    columns = _whitened(whitening, balance.columns(spool))
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    flow = (balance.flow @ whitening.T).ravel()
    return np.linalg.lstsq(columns / norms, flow, rcond=1e-12)[0] / norms, columns


def _rest(balance: Balance[AnyRows], whitening: np.ndarray, spool: SpoolValues) -> np.ndarray:
    """(c N,) whitened, of the best linear parameters."""
    linear, columns = _solved(balance, whitening, spool)
    return (balance.flow @ whitening.T).ravel() - columns @ linear


def _covariance(
    balance: Balance[AnyRows],
    whitening: np.ndarray,
    spool: SpoolValues,
    linear: np.ndarray,
    left: np.ndarray,
) -> np.ndarray:
    """(5 + k, 5 + k) of spool and linear parameters, from the scatter of blocks."""
    at = np.array(spool)
    slopes = []
    for i, scale in enumerate(SCALE):
        step = SPOOL_STEP * scale
        low, high = at.copy(), at.copy()
        low[i], high[i] = max(LOWEST_SPOOL[i], at[i] - step), min(HIGHEST_SPOOL[i], at[i] + step)
        change = (
            balance.columns(SpoolValues(*high)) @ linear
            - balance.columns(SpoolValues(*low)) @ linear
        )
        slopes.append(change / (high[i] - low[i]))
    columns = np.concatenate([np.stack(slopes, axis=2), balance.columns(spool)], axis=2)
    rows = _whitened(whitening, columns)
    norms = np.linalg.norm(rows, axis=0)
    norms[norms == 0.0] = np.inf  # nothing depends on it
    rows = rows / norms
    bread = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
    residual = (left @ whitening.T).ravel()
    blocks = np.repeat(balance.blocks(CORRELATED_BLOCK_S), left.shape[1])
    covariance: np.ndarray = block_covariance(rows, residual, bread, blocks)
    return covariance / np.outer(norms, norms)


def block_covariance(
    rows: np.ndarray, residual: np.ndarray, bread: np.ndarray, blocks: np.ndarray
) -> np.ndarray:
    """(k, k) of the least squares `bread` rows' y of rows (n, k), whose residual (n,) is correlated
    within numbered blocks (n,) only.

    Each residual is that which the fit to all other blocks would leave: a block with much leverage
    pulls the fit to itself and looks better than it is (the jackknife, CR3 of Bell and McCaffrey).
    A scatter of few blocks is not known well, and Student's t allows for that: standard deviations
    are widened so that INTERVAL of a normal distribution covers as much.
    """
    begins = np.flatnonzero(np.diff(blocks, prepend=-1))
    pulls = []
    for part, left in zip(np.split(rows, begins[1:]), np.split(residual, begins[1:]), strict=True):
        complement = np.eye(len(part)) - part @ bread @ part.T
        pulls.append(bread @ part.T @ np.linalg.lstsq(complement, left, rcond=1e-10)[0])
    scatter = np.array(pulls) * np.sqrt((len(pulls) - 1) / len(pulls))
    wider = _widening(scatter)
    covariance: np.ndarray = scatter.T @ scatter * np.outer(wider, wider)
    return covariance


def _widening(scatter: np.ndarray) -> np.ndarray:
    """(k,) of standard deviations from what each of B blocks adds to the estimate, (B, k).

    As many blocks count as there are degrees of freedom in the sum of their squares (Satterthwaite,
    Biometrics Bulletin 2 (1946)), of which normal scatter has the fourth power 3.
    """
    square = scatter**2
    fourth = np.maximum((square**2).sum(axis=0), np.finfo(float).tiny)
    most = max(len(scatter) - 1.0, LEAST_FREE_BLOCKS)
    freedom = (3.0 * square.sum(axis=0) ** 2 / fourth).clip(LEAST_FREE_BLOCKS, most)
    quantile = 0.5 * (1.0 + INTERVAL)
    wider: np.ndarray = student.ppf(quantile, freedom) / normal.ppf(quantile)
    return wider


# Is more left of the flow than noise? The F-test of lack of fit between periods.
#
# As `crane_identification.estimation.autoregression`, on the residual of the balance: what repeats
# from period to period beyond chance is no noise. Only the rounding of the encoder is, which
# repeats where the motion does: how much of it shows by rounding the motion again, the encoder
# shifted.


def lack_of_fit(
    balance: Balance[ChamberRows], found: BalanceFit, logs: Sequence[Log], period: float | None
) -> float | None:
    """How likely noise alone repeats as much; None where no period was repeated."""
    power = noise = variance = of_noise = 0.0
    parts = {log.source: _periodic(log, period) for log in logs}
    for rows in balance.rows:
        part = parts[rows.passage.source]
        if part is None:
            continue
        left = rows.flow - rows.columns(found.spool) @ found.linear
        periods = _folded(rows.time, left @ found.whitening.T, part)
        if len(periods) < 2:
            continue
        mean = periods.mean(axis=0)
        deviation, freedom_of_scatter = periods - mean, len(periods) - 1
        independent = independent_samples(deviation, np.ones(mean.shape, dtype=bool))
        scattered = (deviation**2).sum(axis=(0, 1)) / freedom_of_scatter / len(periods)
        rounded = _repeated_rounding(rows, found.whitening, part)
        power += float((mean**2).sum())
        noise += float(scattered.sum() + rounded.mean())
        variance += float((scattered**2 / independent).sum() + rounded.var() / 2.0)
        of_noise += float((scattered**2 / independent / freedom_of_scatter).sum())
    if not noise:
        return None
    freedom, noise_freedom = noise**2 / variance, noise**2 / of_noise
    kept = max(1.0 - len(found.covariance) / freedom, 0.1)
    return float(fisher.sf(power / noise / kept, kept * freedom, noise_freedom))


def _repeated_rounding(rows: ChamberRows, whitening: np.ndarray, part: Periodicity) -> np.ndarray:
    """(SHIFTS,) power of rounding in the mean of all periods, beyond what its scatter tells."""
    found = []
    for shift in np.arange(SHIFTS) / SHIFTS:
        periods = _folded(rows.time, rows.rounding(shift) @ whitening.T, part)
        mean = periods.mean(axis=0)
        scattered = ((periods - mean) ** 2).sum() / (len(periods) - 1) / len(periods)
        found.append((mean**2).sum() - scattered)
    return np.maximum(found, 0.0)


def _periodic(log: Log, period: float | None) -> Periodicity | None:
    try:
        return periodic_part(log, period)
    except DataError:
        return None


def _folded(time: np.ndarray, values: np.ndarray, part: Periodicity) -> np.ndarray:
    """(M, n, 2) of the whole periods in it, of which a recording with a gap may have none."""
    begin, end = max(time[0], part.start), min(time[-1], part.end)
    count = max(int((end - begin) / part.period + 1e-6), 0)
    samples = round(part.period * ROW_RATE)
    at = begin + part.period / samples * np.arange(count * samples)
    columns = [np.interp(at, time, column) for column in values.T]
    return np.stack(columns, axis=1).reshape(count, samples, values.shape[1])
