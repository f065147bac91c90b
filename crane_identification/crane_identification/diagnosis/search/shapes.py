"""Effects whose law is drawn, over what their joint went through, and signatures of no effect.

Nothing here enters the race: more candidates would raise what chance gives to the best of them. A
shape is asked for an effect that the race found, beside what was found with it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import (
    VISIBLE_SHARE,
    Evidence,
    beside,
    leading,
)
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate, at_shape
from crane_identification.diagnosis.search.search import Search
from crane_model.errors import CraneError
from crane_model.terms import REGISTRY, DrawnTerm, Effect, OneJointTerm, Shape, Term


@dataclass(frozen=True)
class Drawn(Candidate):
    """The effect of `term` with its law drawn `by` another term, at the knots that are `given`."""

    by: type[DrawnTerm] = field(kw_only=True)

    @property
    def drawn(self) -> bool:
        """It is."""
        return True

    @property
    def shapes(self) -> Mapping[str, Shape]:
        """None is sought: it is linear."""
        return {}

    @property
    def effect(self) -> Effect:
        """That of the law, and that it is drawn."""
        return super().effect._replace(name=f"{super().effect.name}, shape as drawn")

    def at(self, shape: Mapping[str, Any]) -> Term:
        """The shape at its knots."""
        return self.by.model_validate({"joint": self.joint, **dict(self.given)})


def shape_of(candidate: Candidate) -> type[DrawnTerm] | None:
    """The term that draws the law of an effect; None where none does, and of changes."""
    drawing = (cls for cls in REGISTRY.values() if issubclass(cls, DrawnTerm))
    known = (cls for cls in drawing if candidate.type in cls.draws)
    return None if candidate.changes or candidate.joint is None else next(known, None)


def drawn(search: Search, candidate: Candidate) -> ShapedCandidate | None:
    """The effect with its law drawn over what its joint went through; None where none does."""
    cls = shape_of(candidate)
    if cls is None:
        return None
    evidence = search.evidence
    x = _followed(evidence, cls, evidence.joints.index(candidate.where))
    try:
        given = (("knots", cls.over(x)),)
        wanted = Drawn(candidate.term, candidate.joint, given, by=cls)
        return at_shape(evidence, wanted, {})
    except (CraneError, ValueError):  # not logged, or it did not change
        return None


def _followed(evidence: Evidence, cls: type[DrawnTerm], j: int) -> np.ndarray:
    """What a shape follows (n,) on the used rows of joint number j."""
    values = (cls.followed(run.record, j)[run.kept] for run in evidence.runs)
    return np.concatenate(list(values))[evidence.used[:, j]]


class Signature(NamedTuple):
    """What a force on a joint may depend on, whatever the law: in words, the `types` of the effects
    that have it, none for one that the catalogue does not know, and its columns (n, c, k).
    """

    said: str
    types: tuple[str, ...]
    columns: np.ndarray


def signatures(search: Search, joint: str) -> Iterator[Signature]:
    """Those on a joint: of effects that can be told from the model, and of no effect."""
    tested = dict.fromkeys(
        one.candidate for one in search.projection.candidates if one.candidate.joint == joint
    )
    seen = set()
    for candidate in tested:
        cls = shape_of(candidate)
        if cls is None or cls in seen or candidate.drawn:
            continue
        seen.add(cls)
        shaped = drawn(search, candidate)
        if shaped is not None:
            yield Signature(cls.said, cls.draws, shaped.columns)
    for stranger in REGISTRY.values():
        if stranger.stranger and issubclass(stranger, OneJointTerm):
            yield Signature(stranger.stranger, (), search.evidence.columns(stranger(joint=joint)))


def explained(search: Search, *columns: np.ndarray) -> float:
    """2 dlogL that columns (n, c, k), whatever their signs, gain together beside the base."""
    white = search.whitener(np.concatenate(columns, axis=2))
    rest = beside(search.base.basis, white)
    seen = np.linalg.norm(rest, axis=0) > VISIBLE_SHARE * np.linalg.norm(white, axis=0)
    known = leading(rest[:, seen], int(seen.sum()))
    return float(((known.T @ search.base.residual) ** 2).sum())
