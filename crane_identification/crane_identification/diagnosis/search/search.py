"""The search for missing effects in one body of evidence: what can be seen of each, by itself."""

from dataclasses import dataclass, field

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.search.candidates import (
    Candidate,
    ShapedCandidate,
    observed,
)
from crane_identification.diagnosis.search.own_noise import holds_noise, of_own_noise
from crane_identification.diagnosis.search.projection import Projection, project
from crane_identification.diagnosis.search.selection import NOTHING, Subset
from crane_identification.diagnosis.search.shapes import Shapes
from crane_identification.diagnosis.search.visibility import left_out, visible
from crane_identification.diagnosis.search.whitening import Base, Whitener, whitened_base, whitener
from crane_model.progress_bar import Progress, silent


@dataclass(frozen=True)
class Search:
    """Evidence, its whitening and base, and all candidates beside it; `sets` are the best of no
    effect, of one, and so on, each size best first. `shapes` are drawn beside the race.
    """

    evidence: Evidence
    whitener: Whitener
    base: Base
    projection: Projection
    untestable: dict[Candidate, str]
    unobservable: dict[Candidate, str]
    sets: tuple[tuple[Subset, ...], ...] = ((NOTHING,),)
    shapes: Shapes = field(default_factory=Shapes)

    def number(self, shaped: ShapedCandidate) -> int:
        """Which of the candidates of the projection it is."""
        return next(i for i, one in enumerate(self.projection.candidates) if one is shaped)


def search(evidence: Evidence, wanted: list[Candidate], progress: Progress = silent) -> Search:
    """The `wanted` candidates beside the model, at the shapes of their grids."""
    found, unobservable = observed(evidence, wanted, progress)
    largest = [one.columns for one in found if not holds_noise(one)]
    white = whitener(evidence, np.concatenate(largest, axis=2))
    base = whitened_base(evidence, white)
    projection = project(white, base, found)
    good, untestable = visible(projection, evidence, white)
    hidden, whole, part = left_out(evidence, found)
    untestable |= whole
    unobservable |= {
        candidate: why for candidate, why in part.items() if candidate not in untestable
    }
    itself, noisy = of_own_noise(evidence, white, base, found)
    kept = projection.kept(good & ~hidden & ~itself)
    shapes = Shapes(evidence, dict.fromkeys(noisy))  # nor is anything drawn of these
    return Search(evidence, white, base, kept, untestable, unobservable, shapes=shapes)
