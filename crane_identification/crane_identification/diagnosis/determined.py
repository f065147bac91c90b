"""What recordings determine of a model: enough rows, and only terms that they tell apart."""

from collections.abc import Sequence
from math import ceil

import numpy as np

from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.refit import UndeterminedError, refit
from crane_identification.diagnosis.scaling import normed
from crane_identification.estimation.regression import common_factor
from crane_identification.preparation.prepare import Preparation
from crane_identification.signals.decimate import KEPT_SHARE
from crane_model.model_file import Model
from crane_model.terms import Term

ENOUGH_ROWS = 60
"""Rows of the joint that moves most. No score exceeds the number of rows, whatever is missing."""


def decimation(training: Sequence[Preparation], given: int | None) -> int:
    """The factor of the rows: the `given` one, or that of the motion.

    Of short recordings more rows are kept, up to the whole bandwidth of the motion. Their noise is
    no longer independent, which whitening takes care of.
    """
    factor = common_factor(training, given)
    if given is not None:
        return factor
    samples = int(sum(one.moving.sum(axis=0) for one in training).max())
    return max(min(factor, samples // ENOUGH_ROWS), ceil(KEPT_SHARE * factor))


def determined(
    model: Model, training: Sequence[Preparation], factor: int, sources: str
) -> tuple[Evidence, Model, tuple[Term, ...]]:
    """The evidence, the model with values, and the terms that had to be left out for them.

    Friction at a single speed is Coulomb or viscous: the recordings show their sum, which one of
    them carries as well. `UndeterminedError` where no such term is the cause.
    """
    left_out: tuple[Term, ...] = ()
    while True:
        evidence = gather(model, training, factor)
        try:
            return evidence, refit(evidence, sources), left_out
        except UndeterminedError as error:
            term = _dispensable(evidence, error)
            model, left_out = model.without_term(term), (*left_out, term)


def _dispensable(evidence: Evidence, error: UndeterminedError) -> Term:
    """Of the terms that are not determined, the one without which least is left unexplained."""
    model, costs = evidence.model, dict[Term, float]()
    for term in model.terms:
        names = {p.name for p in term.parameters(model.setting)}
        if names <= set(error.names) and len(model.terms) > 1:
            costs[term] = _left(evidence, model.part(term))
    if not costs:
        raise error
    return min(costs, key=lambda term: costs[term])


def _left(evidence: Evidence, without: slice) -> float:
    """Energy of the force beside the model without some of its columns, each joint in its unit."""
    weight = np.where(evidence.force_rms > 0.0, evidence.force_rms, 1.0)
    columns = np.delete(evidence.base, without, axis=2)[evidence.used]
    scaling = np.broadcast_to(1.0 / weight, evidence.force.shape)[evidence.used]
    matrix, force = columns * scaling[:, None], evidence.force[evidence.used] * scaling
    matrix, _ = normed(matrix)
    return float(((force - matrix @ np.linalg.lstsq(matrix, force, rcond=1e-9)[0]) ** 2).sum())
