"""Joint estimate of a model on evidence, and of shape parameters the uncertainty beside it."""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.candidates import ShapedCandidate, at_shape
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.runs import Zone
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.whitening import leading
from crane_identification.estimation.consistent import consistent
from crane_identification.estimation.physics import physics
from crane_identification.estimation.rows import Rows
from crane_model.errors import DataError
from crane_model.model_file import Model

STEP = 0.02  # relative, of the difference with respect to a shape parameter


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
    for c in range(evidence.channels):
        used = evidence.used[:, c]
        nuisance = evidence.base[used, c, p:]
        if not nuisance.any():
            continue
        known = leading(nuisance, nuisance.shape[1])
        matrix[used, c] -= known @ (known.T @ matrix[used, c])
        force[used, c] -= known @ (known.T @ force[used, c])
    return matrix, force


def shape_std_devs(
    search: Search, chosen: Sequence[ShapedCandidate], values: Sequence[np.ndarray]
) -> list[dict[str, float]]:
    """One standard deviation of each shape parameter of each candidate, beside everything else.

    Linearized: the derivative of the candidate's force with respect to the parameter is one more
    column. `values` holds the parameters of each candidate.
    """
    evidence, white = search.evidence, search.whitener
    base = [white(one.columns) for one in chosen]
    out: list[dict[str, float]] = []
    slopes, keys = [], []
    for number, (one, value) in enumerate(zip(chosen, values, strict=True)):
        out.append({})
        for name in one.candidate.shapes:
            middle = one.shape[name]
            ends = [
                at_shape(evidence, one.candidate, {**one.shape, name: middle * (1.0 + s)}).columns
                for s in (-STEP, STEP)
            ]
            slope = (ends[1] - ends[0]) @ value / (2.0 * STEP * middle)
            slopes.append(white(slope))
            keys.append((number, name))
    if not slopes:
        return out
    columns = np.concatenate([np.stack(slopes, axis=1), *base], axis=1)
    columns = columns - search.base @ (search.base.T @ columns)
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    gram = (columns / size).T @ (columns / size)
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(gram, rcond=1e-10)))) / size
    for (number, name), std in zip(keys, spread, strict=False):
        out[number][name] = float(std)
    return out
