"""What has changed since a model was made: its values are kept, and its terms are candidates.

The given values count as known as well as their standard deviations say: the covariance that these
give the predicted force, as if the values were independent, is noise beside that of the recordings.
So a change within what the values leave uncertain is no finding. A model file holds no
correlations; where values have some, more counts as uncertain than is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.projection import whitened_base
from crane_identification.diagnosis.refit import UndeterminedError
from crane_identification.diagnosis.scaling import normed
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.whitening import leading
from crane_identification.preparation.run import Preparation
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.terms import Effect, Shape, Term, candidates
from crane_model.terms.gravity_and_load import Payload

SINGULAR_RATIO = 1e-9
"""Smallest over largest singular value of columns of one size, below which some are the same."""


@dataclass(frozen=True)
class Change(Candidate):
    """A change of the parameters of a term that the model has, at the shape that it has."""

    own: Term = field(kw_only=True)

    @property
    def changes(self) -> bool:
        """Of a term that is there."""
        return True

    @property
    def shapes(self) -> Mapping[str, Shape]:
        """None is sought."""
        return {}

    @property
    def effect(self) -> Effect:
        """That of the term, or one made of its name."""
        known = self.term.effect or Effect(
            name=self.type.replace("_", " "),
            signature="the pattern of this term of the model",
            confusable=(),
            settled_by="the same motion on the machine as it was",
        )
        return known._replace(name=f"changed {known.name}")

    def at(self, shape: Mapping[str, Any]) -> Term:
        """The term as it is."""
        return self.own


def check_values(model: Model) -> None:
    """`ConfigurationError` if the model has no values to keep."""
    if model.values is None or model.std_devs is None:
        raise ConfigurationError(
            f"model '{model.name}' has no values that could have changed; fit it with identify to "
            "recordings from before, or leave out --fixed"
        )


def kept(model: Model, training: Sequence[Preparation], factor: int) -> Evidence:
    """The evidence about a model whose values are kept."""
    return replace(gather(model, training, factor), std_devs=model.std_devs)


def changes_of(model: Model) -> list[Candidate]:
    """A change of each term of the model, and a load in all recordings."""
    changed: list[Candidate] = [
        Change(type(term), term.only_joint, own=term) for term in model.terms
    ]
    held = {type(term) for term in model.terms}
    load = Payload in candidates(model.setting) and Payload not in held
    return [*changed, Candidate(Payload, None)] if load else changed


def within(search: Search, model: Model) -> Model:
    """The model with its values where these recordings want them, within what is uncertain of them.

    The most likely ones of independent values with these standard deviations.
    """
    evidence, white = search.evidence, search.whitener
    assert model.std_devs is not None  # of values that are kept
    regressor = evidence.regressor(model)
    nuisance = white(evidence.free)
    base = leading(nuisance, nuisance.shape[1])
    columns, force = (
        rows - base @ (base.T @ rows)
        for rows in (
            white(regressor * model.std_devs),
            white(evidence.force - regressor @ model.theta),
        )
    )
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
    columns, force = (rows - base @ (base.T @ rows) for rows in (columns, white(evidence.left)))
    scaled, norms = normed(columns)
    _, size, directions = np.linalg.svd(scaled, full_matrices=False)
    if size[-1] <= SINGULAR_RATIO * size[0]:
        raise UndeterminedError(model, names)
    minima = [model.parameters[i].minimum for i in where]
    least = np.array([-np.inf if one is None else one for one in minima]) - values[where]
    found = lsq_linear(scaled, force, (least * norms, np.full(len(where), np.inf)))
    values[where] += found.x / norms
    std_devs[where] = np.linalg.norm(directions.T / size, axis=1) / norms
    sources = ", ".join(evidence.sources)
    provenance = f"diagnose --fixed: {', '.join(names)} from {sources}; {before.provenance}"
    return model.with_estimate(values, std_devs, provenance)
