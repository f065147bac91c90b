"""A model with effects added, fitted jointly, and the parameters of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.fit.evidence import beside, gather
from crane_identification.diagnosis.fit.fit import Training
from crane_identification.diagnosis.fit.refit import refit_anyway
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.kept_values import estimated
from crane_identification.diagnosis.search.loads import NO_LOAD
from crane_identification.diagnosis.search.search import Search
from crane_model.model_file import Model

STEP = 0.02  # relative, of the difference with respect to a shape parameter


@dataclass(frozen=True)
class Value:
    """One parameter of a finding, linear or shape; not below `minimum`, if any.

    `before` is what it has changed from, with its standard deviation.
    """

    name: str
    value: float
    std_dev: float
    unit: str
    minimum: float | None = None
    before: tuple[float, float] | None = None

    @property
    def change(self) -> tuple[float, float]:
        """What it adds to the value before or to nothing, with its standard deviation."""
        known, std_dev = self.before or (0.0, 0.0)
        return self.value - known, float(np.hypot(self.std_dev, std_dev))


@dataclass(frozen=True)
class Finding:
    """A finding with its parameters in the extended model."""

    judged: Judged
    parameters: tuple[Value, ...]

    @property
    def candidate(self) -> Candidate:
        """The effect and its joint."""
        return self.judged.shaped.candidate

    @property
    def added(self) -> np.ndarray:
        """Coefficients (k,) of the columns of the effect: its values, or by what they changed."""
        linear = self.parameters[: len(self.judged.shaped.positive)]
        return np.array([one.change[0] for one in linear])


def extended(
    found: Search,
    before: Model,
    judged: Sequence[Judged],
    training: Training,
) -> tuple[Model, list[tuple[Value, ...]]]:
    """The model with the terms, refitted jointly, and the parameters of each.

    `UndeterminedError` where the recordings do not determine all of them.
    """
    if not judged:
        return before, []
    if found.evidence.keeps:
        after = estimated(found, before, [one.shaped for one in judged])
    else:
        model = before
        for one in judged:
            model = model.with_term(one.shaped.term)
        evidence = gather(model, training.recordings, training.factor)
        after, _ = refit_anyway(evidence, training.sources)
    own = [after.part(one.shaped.term) for one in judged]
    assert after.std_devs is not None  # just fitted
    shapes = shape_std_devs(
        found, [one.shaped for one in judged], [after.theta[part] for part in own]
    )
    values = []
    for one, part, spread in zip(judged, own, shapes, strict=True):
        linear = [
            Value(
                after.parameters[i].name,
                float(after.theta[i]),
                float(after.std_devs[i]),
                after.parameters[i].unit,
                after.parameters[i].minimum,
                _before(before, i) if one.shaped.candidate.changes else None,
            )
            for i in range(part.start, part.stop)
        ]
        coordinate = after.setting.units.get(one.shaped.candidate.where, "rad")
        bent = [
            Value(name, float(one.shaped.shape[name]), spread[name], shape.unit_on(coordinate))
            for name, shape in one.shaped.candidate.shapes.items()
        ]
        values.append(tuple(linear + bent))
    return after, values


def _before(model: Model, i: int) -> tuple[float, float]:
    """Value and standard deviation of a parameter."""
    assert model.std_devs is not None  # changes are sought of a model with values
    return float(model.theta[i]), float(model.std_devs[i])


def carried_in(finding: Finding, recordings: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Which recordings carry each load of an effect that differs between them, and which `none`."""
    loads = finding.judged.shaped.term.carried
    if not loads:
        return {}
    pairs = zip(finding.parameters, loads, strict=True)
    carried = {value.name: load.recordings for value, load in pairs}
    loaded = {name for names in carried.values() for name in names}
    return carried | {NO_LOAD: tuple(sorted(set(recordings) - loaded))}


def in_counts(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Parameters that are found in counts."""
    return tuple(replace(one, unit=COUNTS if one.unit != "1" else "1") for one in values)


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
                evidence.columns(one.term.model_copy(update={name: middle * (1.0 + s)}))
                for s in (-STEP, STEP)
            ]
            slope = (ends[1] - ends[0]) @ value / (2.0 * STEP * middle)
            slopes.append(white(slope))
            keys.append((number, name))
    if not slopes:
        return out
    columns = np.concatenate([np.stack(slopes, axis=1), *base], axis=1)
    columns = beside(search.base.basis, columns)
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    gram = (columns / size).T @ (columns / size)
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(gram, rcond=1e-10)))) / size
    for (number, name), std in zip(keys, spread, strict=False):
        out[number][name] = float(std)
    return out
