"""Joint estimate of a model on evidence, and of shape parameters the uncertainty beside it."""

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, beside, leading
from crane_identification.diagnosis.fit.runs import Zone
from crane_identification.estimation.consistent import consistent
from crane_identification.estimation.physics import physics
from crane_identification.estimation.rows import Rows
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


def refit(evidence: Evidence, sources: str) -> Model:
    """The model of the evidence with values and standard deviations, all estimated together.

    `UndeterminedError` where the recordings do not determine all of them.
    """
    model = evidence.model
    parameters = model.parameters
    matrix, force = _beside_nuisances(evidence)
    rows = Rows(
        joints=tuple(f"{joint}, {zone.value}" for zone in Zone for joint in model.joints),
        names=tuple(p.name for p in parameters),
        units=tuple(p.unit for p in parameters),
        time=evidence.time,
        run=evidence.run,
        matrix=matrix,
        force=force,
        used=evidence.used,
    )
    estimate = consistent(rows, physics(model))
    if estimate.undetermined:
        raise UndeterminedError(model, estimate.undetermined)
    provenance = f"diagnose: {estimate.method}, {estimate.samples} rows of {sources}"
    return model.with_estimate(estimate.values, estimate.std_devs, provenance)


def _beside_nuisances(evidence: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """Regressor (n, c, p) and force (n, c) without what the nuisance columns can explain."""
    p = len(evidence.model.parameters)
    matrix, force = evidence.base[:, :, :p].copy(), evidence.force.copy()
    for c, used in enumerate(evidence.used.T):
        nuisance = evidence.base[used, c, p:]
        if not nuisance.any():
            continue
        known = leading(nuisance, nuisance.shape[1])
        matrix[used, c] = beside(known, matrix[used, c])
        force[used, c] = beside(known, force[used, c])
    return matrix, force
