"""Is more left of the flow than noise? The F-test of lack of fit between periods.

As `crane_identification.estimation.lack_of_fit`, on the residual of the balance: what repeats from
period to period beyond chance is no noise. Only the rounding of the encoder is, which repeats where
the motion does: how much of it shows by rounding the motion again, the encoder shifted.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import f as fisher

from crane_identification.data.log import Log
from crane_identification.estimation.lack_of_fit import independent_samples
from crane_identification.hydraulics.balance import ROW_RATE, Balance, ChamberRows
from crane_identification.hydraulics.projection import BalanceFit
from crane_identification.preparation.periodicity import Periodicity, periodic_part
from crane_model.errors import DataError

SHIFTS = 16  # of the encoder, within a count


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
        deviation, others = periods - mean, len(periods) - 1
        independent = independent_samples(deviation, np.ones(mean.shape, dtype=bool))
        scattered = (deviation**2).sum(axis=(0, 1)) / others / len(periods)
        rounded = _repeated_rounding(rows, found.whitening, part)
        power += float((mean**2).sum())
        noise += float(scattered.sum() + rounded.mean())
        variance += float((scattered**2 / independent).sum() + rounded.var() / 2.0)
        of_noise += float((scattered**2 / independent / others).sum())
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
