"""Shapes of friction that explain the force nearly alike, told apart by simulated motion.

Near zero speed the force says little: the sign of the velocity is not known there. A shape that
fits the rest best may stick where the machine slides. The simulated motion goes through there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.decision.decision import Decision
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.fit.evidence import normed
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.kept_values import estimated
from crane_identification.diagnosis.search.race import Race
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset, solve
from crane_identification.validation.motion_validation import validate_motion
from crane_model.model_file import Model
from crane_model.record import Record

SCORE_SHARE = 0.1  # share of an effect's score that its shape may give up for the motion
ERROR_RATIO = 0.95  # of the error of the simulated motion that another shape must stay below
SHAPE_FACTORS = (0.4, 0.63, 0.8, 1.25, 1.6, 2.5)  # between shapes that are tried
SIMULATED_RUNS = 2  # runs, the longest


def suited(race: Race, before: Model, decision: Decision) -> Decision:
    """Each friction found with the shape of those nearly alike that moves most truly."""
    longest = sorted(race.search.evidence.runs, key=lambda run: (-len(run.record), run.source))
    records = [run.record for run in longest[:SIMULATED_RUNS]]
    chosen = list(decision.passed)
    for place, one in enumerate(chosen):
        if not (one.shaped.candidate.shapes and one.shaped.term.is_friction()):
            continue
        tried = _nearly_alike(race, [each.shaped for each in chosen], place, one.score)
        if len(tried) < 2:
            continue
        errors = [_error(before, race.search, subset, one, records) for subset in tried]
        best = int(np.argmin(errors))
        if errors[best] < ERROR_RATIO * errors[0]:
            shaped = race.search.projection.candidates[tried[best].numbers[place]]
            chosen[place] = replace(one, shaped=shaped)
    return replace(decision, passed=tuple(chosen))


def _nearly_alike(
    race: Race, chosen: Sequence[ShapedCandidate], place: int, score: float
) -> list[Subset]:
    """The set as it is, then with other shapes of one effect, by their gain."""
    numbers = [race.search.number(shaped) for shaped in chosen]
    own = solve(race.search.projection, tuple(numbers))
    if own is None:
        return []
    others = []
    for shape in _around(chosen[place]):
        number = race.added(chosen[place].candidate, shape)
        other = solve(race.search.projection, (*numbers[:place], number, *numbers[place + 1 :]))
        if other is not None and own.gain - other.gain < SCORE_SHARE * score:
            others.append(other)
    return [own, *others]


def _around(shaped: ShapedCandidate) -> list[dict[str, float]]:
    """Shapes to either side of that of the candidate, within the range of each parameter."""
    shapes = shaped.candidate.shapes
    return [
        {**shaped.shape, name: value}
        for name, shape in shapes.items()
        for value in (shaped.shape[name] * factor for factor in SHAPE_FACTORS)
        if shape.lowest <= value <= shape.highest
    ]


def _error(
    before: Model, search: Search, subset: Subset, one: Judged, records: Sequence[Record]
) -> float:
    """Error of the simulated motion over the displacement, of the joint that is worst off."""
    candidates = [search.projection.candidates[i] for i in subset.numbers]
    model = (estimated if search.evidence.keeps else _quickly)(search, before, candidates)
    found = validate_motion(model, records)
    if found.reason:
        return np.inf
    joint = one.shaped.candidate.joint
    relative = np.nan_to_num(found.relative)
    return float(relative.max() if joint is None else relative[before.joints.index(joint)])


def _quickly(search: Search, before: Model, candidates: Sequence[ShapedCandidate]) -> Model:
    """The model with the candidates and values, by least squares."""
    evidence, white = search.evidence, search.whitener
    added, known = [shaped.columns for shaped in candidates], len(before.parameters)
    model = before
    for shaped in candidates:
        model = model.with_term(shaped.term)
    columns = np.concatenate([white(values) for values in (*added, evidence.base)], axis=1)
    scaled, norms = normed(columns)
    values = np.linalg.lstsq(scaled, white(evidence.force), rcond=1e-10)[0] / norms
    count = sum(one.shape[2] for one in added)
    theta = np.concatenate([values[count : count + known], values[:count]])
    return model.with_estimate(theta, np.zeros(len(theta)), "trial")
