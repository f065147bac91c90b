"""A flexible learner: how much of a residual any law of the logged quantities could explain."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.stats import ttest_1samp
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import ThreadpoolController

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.features import Features
from crane_identification.thresholds import Thresholds

ITERATIONS = 80
SEED = 7
BLOCK = 10  # rows, some seconds: longer than what a residual remembers
FEWEST_ROWS = 60  # of a joint, below which nothing is learnt


@dataclass(frozen=True)
class Learnt:
    """Out-of-fold prediction (n, j) of a residual, and per joint (j,) the share it explains.

    Folds that it predicts worse than zero, where it has to extrapolate, count as not explained in
    both. `p_value`: how likely a residual without any law gives such gains; `strength`: root mean
    square of what is explained, over that of the joint's force.
    """

    prediction: np.ndarray
    share: np.ndarray
    p_value: np.ndarray
    strength: np.ndarray

    def follows_law(self, thresholds: Thresholds) -> np.ndarray:
        """(j,): whether a law is there, beyond chance and beyond errors of the processing."""
        limit = thresholds.method.false_alarm_rate / 2.0 / len(self.share)
        return (self.p_value < limit) & (self.strength > thresholds.gates.smallest_strength)


def learn(evidence: Evidence, known: Features, residual: np.ndarray, fold: np.ndarray) -> Learnt:
    """Predict the residual (n, j) of each fold (n,) from the others."""
    prediction = np.zeros_like(residual)
    share, strength = np.zeros((2, residual.shape[1]))
    p_value = np.ones(residual.shape[1])
    for j in range(residual.shape[1]):
        used = evidence.used[:, j]
        if used.sum() < FEWEST_ROWS:
            continue
        gain = np.zeros(len(used))
        for number in np.unique(fold[used]):
            inside = used & (fold != number)
            outside = used & (fold == number)
            if inside.sum() < FEWEST_ROWS:
                continue
            model = fitted(known.values[inside], residual[inside, j])
            expected = model.predict(known.values[outside])
            actual = residual[outside, j]
            gain[outside] = actual**2 - (actual - expected) ** 2
            if gain[outside].sum() > 0.0:
                prediction[outside, j] = expected
        power = float((residual[used, j] ** 2).sum())
        left = float(((residual - prediction)[used, j] ** 2).sum())
        share[j] = 1.0 - left / power if power > 0.0 else 0.0
        strength[j] = np.sqrt(max(power - left, 0.0) / used.sum()) / evidence.force_rms[j]
        p_value[j] = _by_chance(gain[used])
    return Learnt(prediction, share, p_value, strength)


def _by_chance(gain: np.ndarray) -> float:
    """p of gains (n,) whose true mean is at most zero; neighbours, alike, count as one block."""
    blocks = gain[: len(gain) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
    return float(ttest_1samp(blocks, 0.0, alternative="greater").pvalue)


def fitted(values: np.ndarray, target: np.ndarray) -> HistGradientBoostingRegressor:
    """The learner on rows (n, f); so few rows are learnt faster by one thread than by several."""
    learner = HistGradientBoostingRegressor(
        max_iter=ITERATIONS,
        learning_rate=0.1,
        max_leaf_nodes=15,
        min_samples_leaf=20,
        l2_regularization=1.0,
        early_stopping=False,
        random_state=SEED,
    )
    with _threads().limit(limits=1):
        return learner.fit(values, target)


@cache
def _threads() -> ThreadpoolController:
    """Of all libraries; to look for them takes as long as several trees."""
    return ThreadpoolController()


def predict_elsewhere(evidence: Evidence, residual: np.ndarray, other: Evidence) -> np.ndarray:
    """The residual (n', j) of other evidence as learnt from this one."""
    here, there = evidence.known, other.known
    out = np.zeros_like(other.force)
    for j in range(residual.shape[1]):
        used = evidence.used[:, j]
        if used.sum() >= FEWEST_ROWS:
            out[:, j] = fitted(here.values[used], residual[used, j]).predict(there.values)
    return out
