"""Shapes by which the measured force explains its own noise: the force at other instants.

A column F(t + lead) - F(t) holds the noise of F(t), which is in what the model leaves as well. The
force that the model predicts has none: a reading that is late shows in that, too.
"""

from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, beside
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.itself import with_predicted_force
from crane_identification.diagnosis.search.whitening import Base, Whitener

LEAD = "lead"  # shape parameter [s]
SHORT = 0.015  # s, in which filtered noise hardly changes, so that its change is none of itself
FOUND_SHARE = 0.5
"""Of a gain by the measured force, that a late reading of the predicted one has. Chosen on delays
of the benchmark, on one of a single chamber, which has least (`test_late.py`), and on a real robot
without a delay (`test_kuka_kr300.py`).
"""


def holds_noise(one: ShapedCandidate) -> bool:
    """Whether a column holds the noise of the force itself, which it would take for what is known
    where noise is estimated.
    """
    return float(one.shape.get(LEAD, 0.0)) > SHORT


def of_own_noise(
    evidence: Evidence, whitener: Whitener, base: Base, found: list[ShapedCandidate]
) -> tuple[np.ndarray, set[Candidate]]:
    """Which (candidates,) may explain but noise by itself, and their effects: those that show less
    in the predicted force, whatever their shape, than in the measured one.
    """
    numbers = [number for number, one in enumerate(found) if LEAD in one.shape]
    predicted = with_predicted_force(evidence) if numbers else evidence
    own, late = np.zeros((2, len(found)))
    for number in numbers:
        one = found[number]
        own[number] = _gain(whitener, base, one.columns)
        shown = _late(predicted, one.shape[LEAD])
        late[number] = _gain(whitener, base, shown.columns(one.term))
    noisy = set()
    for candidate in {found[number].candidate for number in numbers}:
        same = [number for number in numbers if found[number].candidate == candidate]
        if late[same].max() < FOUND_SHARE * own[same].max():
            noisy.add(candidate)
    out = [holds_noise(one) for one in found] | (late < FOUND_SHARE * own)
    return out & [one.candidate in noisy for one in found], noisy


def _late(evidence: Evidence, delay: float) -> Evidence:
    """The evidence, with its force as it is shown `delay` [s] later."""
    runs = []
    for run in evidence.runs:
        true = run.record.needed("force", "a diagnosis")
        shown = np.stack([run.record.shifted(one, -delay) for one in true.T], axis=1)
        runs.append(replace(run, record=replace(run.record, force=shown)))
    return replace(evidence, runs=tuple(runs))


def _gain(whitener: Whitener, base: Base, columns: np.ndarray) -> float:
    """2 dlogL of a single column (n, c, 1) beside the base."""
    rest = beside(base.basis, whitener(columns))
    power = float((rest**2).sum())
    return float(((rest.T @ base.residual) ** 2).sum()) / power if power > 0.0 else 0.0
