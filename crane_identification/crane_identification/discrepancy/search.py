"""The search for missing effects on one body of evidence: grid, beam, refinement of shapes."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from crane_identification.discrepancy.candidates import Family, Option, families, option, options
from crane_identification.discrepancy.evidence import Evidence
from crane_identification.discrepancy.projection import (
    Projection,
    project,
    testable,
    whitened_base,
)
from crane_identification.discrepancy.selection import Choice, best_sets, solve
from crane_identification.discrepancy.whitening import Whitener, whitener
from crane_identification.progress import Progress, silent

EVALUATIONS = 8  # of each shape parameter when it is refined
RIVALS = 3  # best families of size one whose shapes are refined, so that the race is fair
NEIGHBOUR = 0.6  # of the range (logarithmic) that lies to either side of a grid point


@dataclass
class Search:
    """Evidence, its whitening and base, and all options beside it, which refinement adds to."""

    evidence: Evidence
    whitener: Whitener
    base: np.ndarray
    projection: Projection
    untestable: dict[Family, str]
    unobservable: dict[Family, str]
    sizes: list[list[Choice]] = field(default_factory=list)

    @property
    def explainable(self) -> float:
        """Energy of the residual beyond noise of variance one."""
        rows = len(self.projection.residual) - self.base.shape[1]
        return float(self.projection.residual @ self.projection.residual) - rows

    def best(self, size: int) -> Choice | None:
        """The best set of so many effects."""
        return self.sizes[size - 1][0] if 0 < size <= len(self.sizes) else None

    def terms(self, choice: Choice) -> list[Option]:
        """The options of a set."""
        return [self.projection.options[i] for i in choice.options]

    def refine(self, choice: Choice) -> Choice:
        """The set with the shapes of its options refined, which become options of their own."""
        for place in range(len(choice.options)):
            for name in self.projection.options[choice.options[place]].family.term.shapes:
                choice = self._refined(choice, place, name)
        return choice

    def _refined(self, choice: Choice, place: int, name: str) -> Choice:
        start = self.projection.options[choice.options[place]]
        shape = start.family.term.shapes[name]
        points = len({one[name] for one in start.family.grid()})
        step = np.log(shape.highest / shape.lowest) / max(points - 1, 1) * NEIGHBOUR
        middle = np.log(start.shape[name])
        low = max(middle - step, np.log(shape.lowest))
        high = min(middle + step, np.log(shape.highest))
        found: dict[float, tuple[float, Projection, Choice]] = {}

        def cost(position: float) -> float:
            value = {**start.shape, name: float(np.exp(position))}
            trial = self._with(start.family, value)
            numbers = list(choice.options)
            numbers[place] = len(trial.options) - 1
            solved = solve(trial, tuple(numbers))
            found[position] = (solved.gain if solved else -np.inf, trial, solved or choice)
            return -found[position][0]

        minimize_scalar(
            cost, bounds=(low, high), method="bounded", options={"maxiter": EVALUATIONS}
        )
        gain, projection, solved = max(found.values(), key=lambda entry: entry[0])
        if gain <= choice.gain:
            return choice
        self.projection = projection
        return solved

    def _with(self, family: Family, shape: dict[str, Any]) -> Projection:
        """The projection with one more option, the last."""
        one = project(
            self.evidence, self.whitener, [option(self.evidence, family, shape)], self.base
        )
        old = self.projection
        grown = replace(
            old,
            options=old.options + one.options,
            columns=np.concatenate([old.columns, one.columns], axis=1),
            owner=np.concatenate([old.owner, one.owner + len(old.options)]),
            positive=np.concatenate([old.positive, one.positive]),
            scale=np.concatenate([old.scale, one.scale]),
            visibility=np.concatenate([old.visibility, one.visibility]),
        )
        # Inner products of the old columns are known.
        mixed = old.columns.T @ one.columns
        grown.__dict__["gram"] = np.block([[old.gram, mixed], [mixed.T, one.gram]])
        return grown


def search(evidence: Evidence, progress: Progress = silent) -> Search:
    """All candidates of the catalogue, up to three together, their shapes refined."""
    wanted = families(evidence.model, len(evidence.runs))
    found, unobservable = options(evidence, wanted, progress)
    white = whitener(evidence, np.concatenate([one.columns for one in found], axis=2))
    base = whitened_base(evidence, white)
    projection = project(evidence, white, found, base)
    good, untestable = testable(projection)
    out = Search(evidence, white, base, projection.kept(good), untestable, unobservable)
    out.sizes = best_sets(out.projection)
    for size in range(1, len(out.sizes) + 1):
        rivals = out.sizes[size - 1][: RIVALS if size == 1 else 1]
        for number, choice in enumerate(rivals):
            out.refine(choice)
            progress("search", (size - 1 + (number + 1) / len(rivals)) / len(out.sizes))
        out.sizes = best_sets(out.projection)
    return out
