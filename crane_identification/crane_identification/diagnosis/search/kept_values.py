"""What has changed since a model was made, whose other values are kept.

The given values count as known as well as their standard deviations say: the covariance that these
give the predicted force, as if the values were independent, is noise beside that of the recordings.
So a change within what the values leave uncertain is no finding. A model file holds no
correlations; where values have some, more counts as uncertain than is.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.diagnosis.fit.evidence import beside, leading, normed
from crane_identification.diagnosis.fit.refit import UndeterminedError
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.whitening import whitened_base
from crane_model.model_file import Model

SINGULAR_RATIO = 1e-9
"""Smallest over largest singular value of columns of one size, below which some are the same."""


def within(search: Search, model: Model) -> Model:
    """The model with its values where these recordings want them, within what is uncertain of them.

    The most likely ones of independent values with these standard deviations.
    """
    evidence, white = search.evidence, search.whitener
    assert model.std_devs is not None  # of values that are kept
    regressor = evidence.regressor(model)
    nuisance = white(evidence.free)
    base = leading(nuisance, nuisance.shape[1])
    columns = beside(base, white(regressor * model.std_devs))
    force = beside(base, white(evidence.force - regressor @ model.theta))
    p = len(model.theta)
    sigmas = np.linalg.lstsq(
        np.concatenate([columns, np.eye(p)]), np.concatenate([force, np.zeros(p)])
    )[0]
    return replace(model, values=model.theta + model.std_devs * sigmas)


def estimated(search: Search, before: Model, candidates: Sequence[ShapedCandidate]) -> Model:
    """The model with the parameters of the candidates, and with its other values as they were.

    A changed value is that of these recordings alone: its standard deviation holds what the values
    that did not change leave uncertain, but not its own from before. `UndeterminedError` where the
    recordings do not determine them.
    """
    evidence, white = search.evidence, search.whitener
    model = before
    for one in candidates:
        model = model if one.candidate.changes else model.with_term(one.term)
    parts = [np.arange(len(model.parameters))[model.part(one.term)] for one in candidates]
    where, p = np.concatenate(parts), len(before.parameters)
    values, std_devs = np.zeros((2, len(model.parameters)))
    values[:p], std_devs[:p] = before.theta, evidence.std_devs
    std_devs[where] = 0.0
    names = tuple(model.parameters[i].name for i in where)
    base = whitened_base(replace(evidence, std_devs=std_devs[:p]), white)
    columns = white(np.concatenate([one.columns for one in candidates], axis=2))
    scaled, norms = normed(beside(base.basis, columns))
    _, size, directions = np.linalg.svd(scaled, full_matrices=False)
    if size[-1] <= SINGULAR_RATIO * size[0]:
        raise UndeterminedError(model, names)
    minima = [model.parameters[i].minimum for i in where]
    least = np.array([-np.inf if one is None else one for one in minima]) - values[where]
    found = lsq_linear(scaled, base.residual, (least * norms, np.full(len(where), np.inf)))
    values[where] += found.x / norms
    std_devs[where] = np.linalg.norm(directions.T / size, axis=1) / norms
    sources = ", ".join(evidence.sources)
    provenance = f"diagnose --fixed: {', '.join(names)} from {sources}; {before.provenance}"
    return model.with_estimate(values, std_devs, provenance)
