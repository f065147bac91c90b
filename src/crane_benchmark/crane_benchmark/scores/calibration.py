"""What cases that hide nothing say of thresholds, and of the bootstrap inside a diagnosis."""

from collections.abc import Sequence

import numpy as np

from crane_benchmark.answers.answer_cases import AnswerStatistics
from crane_benchmark.scores.summary import Rate, rate
from crane_model.result_file import ResultPart

TAIL = 4  # the largest values, one in so many, say how a tail falls off
LEVEL = 97  # %, of the bootstrap quantile that null cases are compared with


def together(
    values: np.ndarray, allowed: float, least: Sequence[float] = ()
) -> tuple[np.ndarray, int]:
    """Limits (g,) of gates with these `values` (n, g) in n null cases, of which the share `allowed`
    may pass any; and how many pass.

    Each gate gets the same part of the alarms, by the fall of its tail, and none becomes lower than
    its `least`. If too many pass, all are raised together, one value at a time, with a margin of
    half a step.
    """
    ordered = np.sort(values, axis=0)
    count, gates = values.shape
    floors = np.maximum(tails(ordered, allowed / gates), least if len(least) else 0.0)
    for rank in range(count):
        above = ordered[min(rank + 1, count - 1)]
        limits = np.maximum((ordered[rank] + above) / 2.0, floors)
        alarms = int((values > limits).any(axis=1).sum())
        if alarms <= allowed * count:
            break
    return limits, alarms


def tails(ordered: np.ndarray, share: float) -> np.ndarray:
    """(g,) what this `share` of cases is above, by exponential tails of sorted values (n, g).

    60 cases hold no 0.6 % quantile; the median step of the largest quarter, which one odd case does
    not move, tells where it lies. Zero for gates that most cases do not even reach.
    """
    count = max(len(ordered) // TAIL, 1)
    start = ordered[-count - 1]
    fall = np.median(ordered[-count:] - start, axis=0) / np.log(2.0)
    return np.where(fall > 0.0, start + fall * np.log(count / (share * len(ordered))), 0.0)


class BootstrapAgreement(ResultPart):
    """Scores of null cases through the whole sensor chain, and what the bootstrap promises, in
    units of the quantile that is the threshold.
    """

    level: float
    """Quantile of the bootstrap that cases are compared with [-]."""
    above: Rate
    """Of cases above it; the share that it leaves, if both agree."""
    found: list[float]
    """Scores, sorted [-]."""
    promised: list[float]
    """Those at the same ranks by the bootstrap [-]."""


def agreement(known: Sequence[AnswerStatistics]) -> BootstrapAgreement:
    """How far both agree."""
    score = np.array([one.best for one in known])
    promised = np.array([one.promised for one in known])  # (n, 101)
    levels = 100.0 * (np.arange(len(score)) + 0.5) / len(score)
    return BootstrapAgreement(
        level=LEVEL / 100.0,
        above=rate((score > promised[:, LEVEL]).tolist()),
        found=np.sort(score).tolist(),
        promised=np.interp(levels, np.arange(101), promised.mean(axis=0)).tolist(),
    )
