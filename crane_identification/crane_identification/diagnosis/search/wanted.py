"""What is asked of the recordings: effects that a model lacks, and where its values are kept, also
changes of the terms that it has.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.search.candidates import Candidate, candidates_of
from crane_model.model_file import Model
from crane_model.terms import Effect, Shape, Term, candidates
from crane_model.terms.gravity_and_load import Payload


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


def changes_of(model: Model) -> list[Candidate]:
    """A change of each term of the model, and a load in all recordings."""
    changed: list[Candidate] = [
        Change(type(term), term.only_joint, own=term) for term in model.terms
    ]
    held = {type(term) for term in model.terms}
    load = Payload in candidates(model.setting) and Payload not in held
    return [*changed, Candidate(Payload, None)] if load else changed


def wanted(fit: Fitted, without: Collection[str]) -> list[Candidate]:
    """The candidates that are asked for: not `without`, and none that the model had."""
    had = {(term.type, term.only_joint) for term in fit.left_out}
    changed = changes_of(fit.evidence.model) if fit.fixed else []
    return [
        candidate
        for candidate in (*candidates_of(fit.before, fit.evidence), *changed)
        if candidate.type not in without and (candidate.type, candidate.joint) not in had
    ]
