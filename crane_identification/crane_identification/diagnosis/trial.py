"""A model with effects added: what it is after the fit, refitted jointly, and what it leaves.

Where its values are kept, what changed is estimated alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.data.units import COUNTS
from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.changes import estimated, within
from crane_identification.diagnosis.cross_validation import folds
from crane_identification.diagnosis.decision import Judged
from crane_identification.diagnosis.evidence import gather
from crane_identification.diagnosis.fit import Fitted, Training
from crane_identification.diagnosis.gap import residual
from crane_identification.diagnosis.learner import Learnt, learn
from crane_identification.diagnosis.loads import LOADS, NO_LOAD, Loads
from crane_identification.diagnosis.refit import refit, shape_std_devs
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.thresholds import Thresholds
from crane_model.model_file import Model


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
        after = refit(gather(model, training.recordings, training.factor), training.sources)
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
    loads: Loads | None = getattr(finding.judged.shaped.term, LOADS, None)
    if loads is None:
        return {}
    pairs = zip(finding.parameters, loads, strict=True)
    carried = {value.name: load.recordings for value, load in pairs}
    loaded = {name for names in carried.values() for name in names}
    return carried | {NO_LOAD: tuple(sorted(set(recordings) - loaded))}


def in_counts(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Parameters that are found in counts."""
    return tuple(replace(one, unit=COUNTS if one.unit != "1" else "1") for one in values)


@dataclass(frozen=True)
class Trial:
    """`model` is that with the `effects`, fitted; `values` are the parameters of each.

    `zero` are further effects whose parameters may as well be zero.

    On the training recordings: its `residual` (n, c), `energy` (c,) of it in units of the noise,
    `left_share` of the energy beyond noise where the effects act, and what is `learnt` from the
    residual, beyond what is uncertain of values that are kept.
    """

    effects: tuple[Judged, ...]
    zero: tuple[Judged, ...]
    values: tuple[tuple[Value, ...], ...]
    model: Model
    residual: np.ndarray
    learnt: Learnt
    energy: np.ndarray
    left_share: float

    @property
    def distrusted(self) -> set[str]:
        """Joints whose sensors are wrong, by these effects."""
        candidates = (one.shaped.candidate for one in self.effects)
        return {candidate.where for candidate in candidates if candidate.term.is_of_sensors()}

    def explained(self, before: "Trial", thresholds: Thresholds) -> float:
        """Share of what can be explained of what is left `before` that the effects do."""
        learnable = np.where(self.learnt.follows_law(thresholds), self.learnt.share, 0.0)
        remaining = float((self.energy[: len(learnable)] * learnable).sum())
        own = max(float((before.energy - self.energy).sum()), 0.0)
        return own / max(own + remaining, np.finfo(float).tiny)


def tried(fit: Fitted, search: Search, effects: Sequence[Judged], thresholds: Thresholds) -> Trial:
    """The model with effects; those whose parameters may as well be zero are left out.

    `UndeterminedError` where the recordings do not determine all parameters.
    """
    chosen = tuple(effects)
    while True:
        model, values = extended(search, fit.before, chosen, fit.training)
        sure = tuple(
            one
            for one, own in zip(chosen, values, strict=True)
            if differs(one, own, thresholds.method.parameter_sigmas)
        )
        if sure == chosen:
            break
        chosen = sure
    evidence = fit.evidence
    left = residual(evidence, model)
    beyond = residual(evidence, within(search, model)) if evidence.keeps else left
    seen = evidence.moving
    return Trial(
        effects=chosen,
        zero=tuple(one for one in effects if one not in chosen),
        values=tuple(values),
        model=model,
        residual=left,
        learnt=learn(seen, fit.known, beyond[:, : len(evidence.joints)], folds(seen)[0]),
        energy=normalized_energy(search, left),
        left_share=search.left_share([one.shaped for one in chosen]),
    )


def differs(one: Judged, values: Sequence[Value], sigmas: float) -> bool:
    """Whether a parameter of an effect is not zero, or has changed, by more than so many standard
    deviations; shapes alone say nothing.
    """
    changes = [value.change for value in values[: len(one.shaped.positive)]]
    return any(abs(change) > sigmas * std_dev for change, std_dev in changes)


def normalized_energy(search: Search, left: np.ndarray) -> np.ndarray:
    """Energy (c,) of a residual (n, c) in units of the noise."""
    variance = [1.0 if noise is None else noise.variance for noise in search.whitener.noise]
    return (np.where(search.evidence.used, left, 0.0) ** 2).sum(axis=0) / np.array(variance)
