"""Joint estimate of a model on evidence, and of shape parameters the uncertainty beside it.

A parameter counts as not determined where its column is, or nearly is, a combination of others, or
where what is left of the force hides it. The latter holds only of a column that others follow:
what is left may be what the model lacks, beside which a parameter of its own seems uncertain.
"""

import numpy as np

from crane_identification.diagnosis.fit.evidence import (
    VISIBLE_SHARE,
    Evidence,
    beside,
    leading,
    says_nothing,
)
from crane_identification.diagnosis.fit.runs import Zone
from crane_identification.estimation.consistent import consistent
from crane_identification.estimation.least_squares import UNSEEN
from crane_identification.estimation.physics import physics
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import Rows, balancing, solve_weighted
from crane_model.errors import DataError
from crane_model.model_file import Model


class UndeterminedError(DataError):
    """The recordings show only combinations of the parameters `names` of a model."""

    def __init__(self, model: Model, names: tuple[str, ...]) -> None:
        self.names = names
        super().__init__(
            f"model '{model.name}': {', '.join(names)}: these recordings show only "
            "combinations of these parameters; excite the joints more or take terms out"
        )


def refit(evidence: Evidence, sources: str, held: tuple[str, ...] = ()) -> Model:
    """The model of the evidence with values and standard deviations, all estimated together.

    Parameters that are `held` are 0 as far as the recordings do not tell them from the others: the
    force is that of what is determined. `UndeterminedError` where others are not determined.
    """
    model, rows = evidence.model, _rows(evidence)
    prior = _no_more_than_measured(rows, held) if held else None
    # Bodies in space would be fitted to what an incomplete model lacks, up to where they can exist.
    estimate = consistent(rows, physics(model, bodies_in_space=False), prior=prior)
    if estimate.undetermined:
        if lost := _alike(rows, estimate.undetermined):
            raise UndeterminedError(model, (*held, *lost))
        return refit(evidence, sources, (*held, *estimate.undetermined))
    provenance = f"diagnose: {estimate.method}, {estimate.samples} rows of {sources}"
    return model.with_estimate(estimate.values, estimate.std_devs, provenance)


def refit_anyway(evidence: Evidence, sources: str) -> tuple[Model, tuple[str, ...]]:
    """The same with all parameters held that are not determined, and their names."""
    held: tuple[str, ...] = ()
    while True:
        try:
            return refit(evidence, sources, held), held
        except UndeterminedError as error:
            held = error.names


def _no_more_than_measured(rows: Rows, names: tuple[str, ...]) -> Prior:
    """By which each of these parameters is 0, give or take what makes as much force alone, on some
    joint, as was measured.
    """
    force, unit, widths = rows.rms(rows.force), np.eye(len(rows.names)), []
    chosen = [rows.names.index(name) for name in names]
    for k in chosen:
        column = rows.rms(rows.matrix[:, :, k])
        seen = (column > 0.0) & (force > 0.0)
        widths.append(UNSEEN * float((force[seen] / column[seen]).min(initial=np.inf)))
    known = np.where(np.isfinite(widths), widths, 1.0)  # what makes no force may be anything
    return Prior(unit[chosen] / known[:, np.newaxis], np.zeros(len(chosen)))


def _alike(rows: Rows, names: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the parameters whose columns are nearly combinations of others."""
    weights = np.broadcast_to(balancing(rows), rows.force.shape)
    found = solve_weighted(rows, weights)
    norms = np.linalg.norm(rows.stacked * weights[rows.used][:, None], axis=0)
    spread = np.sqrt(np.diag(found.bread)) * norms
    share = np.divide(1.0, spread, out=np.zeros_like(spread), where=found.determined)
    return tuple(name for name in names if share[rows.names.index(name)] < VISIBLE_SHARE)


def _rows(evidence: Evidence) -> Rows:
    """The equations of the channels that tell more than their unknowns are."""
    parameters = evidence.model.parameters
    matrix, force, used = _beside_nuisances(evidence)
    return Rows(
        joints=tuple(f"{joint}, {zone.value}" for zone in Zone for joint in evidence.joints),
        names=tuple(p.name for p in parameters),
        units=tuple(p.unit for p in parameters),
        time=evidence.time,
        run=evidence.run,
        matrix=matrix,
        force=force,
        used=used,
    )


def _beside_nuisances(evidence: Evidence) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Regressor (n, c, p) and force (n, c) without what the nuisance columns can explain, and which
    rows count (n, c).
    """
    p = len(evidence.model.parameters)
    matrix, force = evidence.base[:, :, :p].copy(), evidence.force.copy()
    counted = evidence.used.copy()
    for c, used in enumerate(evidence.used.T):
        counted[:, c] &= not says_nothing(used, leading(evidence.base[used, c], len(used)))
        nuisance = evidence.base[used, c, p:]
        if not nuisance.any():
            continue
        known = leading(nuisance, nuisance.shape[1])
        matrix[used, c] = beside(known, matrix[used, c])
        force[used, c] = beside(known, force[used, c])
    return matrix, force, counted
