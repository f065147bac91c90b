"""Effects whose law is drawn, over what their joint went through, and signatures of no effect.

Nothing here enters the race: more candidates would raise what chance gives to the best of them. A
shape is asked for an effect that the race found, beside what was found with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate, at_shape
from crane_identification.diagnosis.search.itself import is_the_force_itself
from crane_model.errors import CraneError
from crane_model.terms import DRAWING, DrawnTerm, Effect, Shape, Term, strangers


@dataclass(frozen=True)
class Drawn(Candidate):
    """The effect of `term` with its law drawn `by` another term, at the knots that are `given`."""

    by: type[DrawnTerm] = field(kw_only=True)

    @property
    def drawn(self) -> bool:
        """It is, by values at knots."""
        return True

    @property
    def shapes(self) -> Mapping[str, Shape]:
        """None is sought: it is linear."""
        return {}

    @property
    def effect(self) -> Effect:
        """That of the law, by its signature alone."""
        known = super().effect
        return known._replace(name=f"{known.name}, shape as drawn", signature=self.by.said)

    def at(self, shape: Mapping[str, Any]) -> Term:
        """The shape at its knots."""
        return self.by.model_validate({"joint": self.joint, **dict(self.given)})


class ForceSignature(NamedTuple):
    """What a force on a joint depends on, whatever the law: in words, the `types` of the effects
    that have it, none where the catalogue knows no such effect, its term and the columns (n, c, k).
    """

    said: str
    types: tuple[str, ...]
    term: Term
    columns: np.ndarray


@dataclass(frozen=True)
class Shapes:
    """What is drawn over some evidence, each once, when it is asked for; nothing without any."""

    evidence: Evidence | None = None
    drawn: dict[Candidate, ShapedCandidate | None] = field(default_factory=dict)
    strange: dict[str, tuple[ForceSignature, ...]] = field(default_factory=dict)

    def of(self, candidate: Candidate) -> ShapedCandidate | None:
        """The effect with its law drawn; None where nothing draws it."""
        if candidate not in self.drawn:
            self.drawn[candidate] = (
                None if self.evidence is None else _drawn(self.evidence, candidate)
            )
        return self.drawn[candidate]

    def strangers(self, joint: str) -> tuple[ForceSignature, ...]:
        """Signatures on a joint that no effect of the catalogue has."""
        if self.evidence is None:
            return ()
        if joint not in self.strange:
            terms = strangers(self.evidence.model.setting, joint)
            self.strange[joint] = tuple(
                one for term in terms if (one := _stranger(self.evidence, term)) is not None
            )
        return self.strange[joint]


def shape_of(candidate: Candidate) -> type[DrawnTerm] | None:
    """The term that draws the law of an effect; None where none does, and of changes."""
    free = candidate.joint is not None and not candidate.changes
    return DRAWING.get(candidate.type) if free else None


def _stranger(evidence: Evidence, term: Term) -> ForceSignature | None:
    """The signature of a term; None where what it follows was not logged."""
    try:
        return ForceSignature(term.stranger, (), term, evidence.columns(term))
    except CraneError:
        return None


def _drawn(evidence: Evidence, candidate: Candidate) -> ShapedCandidate | None:
    cls = shape_of(candidate)
    if cls is None:
        return None
    j = evidence.joints.index(candidate.where)
    try:
        followed = [cls.followed(run.record, j)[run.kept] for run in evidence.runs]
        given = (("knots", cls.over(np.concatenate(followed)[evidence.used[:, j]])),)
        drawn = at_shape(evidence, Drawn(candidate.term, candidate.joint, given, by=cls), {})
    except (CraneError, ValueError):  # not logged, never but close to reversals, or unchanged
        return None
    over_force = cls.variable.startswith("force")
    own = over_force and is_the_force_itself(evidence, drawn.term, candidate.where)
    return None if own else drawn
