"""Shapes that explain the force nearly alike, told apart by the motion that they simulate.

Near zero speed the force says little: the sign of the velocity is not known there. A shape that
fits the rest best may stick where the machine slides. The simulated motion goes through there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.candidates import Option
from crane_identification.diagnosis.changes import estimated
from crane_identification.diagnosis.decision import Decision, Judged
from crane_identification.diagnosis.scaling import normed
from crane_identification.diagnosis.search import Race, Search
from crane_identification.diagnosis.selection import Choice, solve
from crane_identification.validation.motion_validation import validate_motion
from crane_model.model_file import Model
from crane_model.record import Record

SCORE_SHARE = 0.1  # share of an effect's score that its shape may give up for the motion
ERROR_RATIO = 0.95  # of the error of the simulated motion that another shape must stay below
SHAPE_FACTORS = (0.4, 0.63, 0.8, 1.25, 1.6, 2.5)  # between shapes that are tried
SIMULATED_RUNS = 2  # runs, the longest


def suited(race: Race, before: Model, decision: Decision) -> Decision:
    """Each accepted effect with the shape of those nearly alike that moves most truly."""
    longest = sorted(race.search.evidence.runs, key=lambda run: (-len(run.record), run.source))
    records = [run.record for run in longest[:SIMULATED_RUNS]]
    chosen = list(decision.accepted)
    for place, one in enumerate(chosen):
        if not one.option.family.shapes:
            continue
        tried = _nearly_alike(race, [each.option for each in chosen], place, one.score)
        if len(tried) < 2:
            continue
        errors = [_error(before, race.search, choice, one, records) for choice in tried]
        best = int(np.argmin(errors))
        if errors[best] < ERROR_RATIO * errors[0]:
            option = race.search.projection.options[tried[best].options[place]]
            chosen[place] = replace(one, option=option)
    return replace(decision, accepted=tuple(chosen))


def _nearly_alike(race: Race, chosen: Sequence[Option], place: int, score: float) -> list[Choice]:
    """The set as it is, then with other shapes of one effect, by their gain."""
    numbers = [race.search.number(option) for option in chosen]
    own = solve(race.search.projection, tuple(numbers))
    if own is None:
        return []
    others = []
    for shape in _around(chosen[place]):
        number = race.added(chosen[place].family, shape)
        other = solve(race.search.projection, (*numbers[:place], number, *numbers[place + 1 :]))
        if other is not None and own.gain - other.gain < SCORE_SHARE * score:
            others.append(other)
    return [own, *others]


def _around(option: Option) -> list[dict[str, float]]:
    """Shapes to either side of that of the option, within the range of each parameter."""
    shapes = option.family.shapes
    return [
        {**option.shape, name: value}
        for name, shape in shapes.items()
        for value in (option.shape[name] * factor for factor in SHAPE_FACTORS)
        if shape.lowest <= value <= shape.highest
    ]


def _error(
    before: Model, search: Search, choice: Choice, one: Judged, records: Sequence[Record]
) -> float:
    """Error of the simulated motion over the displacement, of the joint that is worst off."""
    options = [search.projection.options[i] for i in choice.options]
    model = (estimated if search.evidence.keeps else _quickly)(search, before, options)
    found = validate_motion(model, records)
    if found.reason:
        return np.inf
    joint = one.option.family.joint
    relative = np.nan_to_num(found.relative)
    return float(relative.max() if joint is None else relative[before.joints.index(joint)])


def _quickly(search: Search, before: Model, options: Sequence[Option]) -> Model:
    """The model with the options and values, by least squares."""
    evidence, white = search.evidence, search.whitener
    added, known = [option.columns for option in options], len(before.parameters)
    model = before
    for option in options:
        model = model.with_term(option.term)
    columns = np.concatenate([white(values) for values in (*added, evidence.base)], axis=1)
    scaled, norms = normed(columns)
    values = np.linalg.lstsq(scaled, white(evidence.force), rcond=1e-10)[0] / norms
    count = sum(one.shape[2] for one in added)
    theta = np.concatenate([values[count : count + known], values[:count]])
    return model.with_estimate(theta, np.zeros(len(theta)), "trial")
