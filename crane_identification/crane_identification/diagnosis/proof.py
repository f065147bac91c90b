"""Effects that passed the training recordings, before recordings that took no part."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.diagnosis.candidates import NO_LOAD, Candidate, ShapedCandidate
from crane_identification.diagnosis.evidence import beside, gather, leading, normed
from crane_identification.diagnosis.fit import Fitted, Training, UndeterminedError, refit_anyway
from crane_identification.diagnosis.gap import (
    RESOLUTION,
    Gap,
    Learnt,
    Line,
    clearest_lines,
    learn,
    measure,
    pulsations,
    unchanged,
)
from crane_identification.diagnosis.judgement import Judged, Reason, Rejection, folds
from crane_identification.diagnosis.projection import whitened_base
from crane_identification.diagnosis.search import Search
from crane_identification.thresholds import Thresholds
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

# What has changed since a model was made, whose other values are kept.
#
# The given values count as known as well as their standard deviations say: the covariance that
# these give the predicted force, as if the values were independent, is noise beside that of the
# recordings. So a change within what the values leave uncertain is no finding. A model file holds
# no correlations; where values have some, more counts as uncertain than is.

SINGULAR_RATIO = 1e-9
"""Smallest over largest singular value of columns of one size, below which some are the same."""


def within(search: Search, model: Model) -> Model:
    """The model with the most likely values of these recordings, within their deviations."""
    evidence, white = search.evidence, search.whitener
    assert model.std_devs is not None  # of values that are kept
    regressor = evidence.regressor(model)
    nuisance = white(evidence.free)
    base = leading(nuisance, nuisance.shape[1])
    columns = beside(base, white(regressor * model.std_devs))
    force = beside(base, white(evidence.force - regressor @ model.theta))
    p = len(model.theta)
    sigmas = np.linalg.lstsq(
        np.concatenate([columns, np.eye(p)]), np.concatenate([force, np.zeros(p)])
    )[0]
    return replace(model, values=model.theta + model.std_devs * sigmas)


def estimated(search: Search, before: Model, candidates: Sequence[ShapedCandidate]) -> Model:
    """The model with the parameters of the candidates, and its other values as they were; the
    standard deviations hold what the other values leave uncertain. `UndeterminedError` if the
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
    scaled, norms = normed(beside(base.basis, columns))
    _, size, directions = np.linalg.svd(scaled, full_matrices=False)
    if size[-1] <= SINGULAR_RATIO * size[0]:
        raise UndeterminedError(model, names)
    minima = [model.parameters[i].minimum for i in where]
    least = np.array([-np.inf if one is None else one for one in minima]) - values[where]
    found = lsq_linear(scaled, base.residual, (least * norms, np.full(len(where), np.inf)))
    values[where] += found.x / norms
    std_devs[where] = np.linalg.norm(directions.T / size, axis=1) / norms
    sources = ", ".join(evidence.sources)
    provenance = f"diagnose --fixed: {', '.join(names)} from {sources}; {before.provenance}"
    return model.with_estimate(values, std_devs, provenance)


STEP = 0.02  # relative, of the difference with respect to a nonlinear parameter


@dataclass(frozen=True)
class Value:
    """One parameter of a finding, linear or shape; `before`: value and standard deviation that it
    changed from.
    """

    name: str
    value: float
    std_dev: float
    unit: str
    minimum: float | None = None
    before: tuple[float, float] | None = None

    @property
    def change(self) -> tuple[float, float]:
        """Change from the value before or from nothing, with its standard deviation."""
        known, std_dev = self.before or (0.0, 0.0)
        return self.value - known, float(np.hypot(self.std_dev, std_dev))


@dataclass(frozen=True)
class Finding:
    """A finding with its parameters in the extended model."""

    judged: Judged
    parameters: tuple[Value, ...]

    @property
    def candidate(self) -> Candidate:
        return self.judged.shaped.candidate

    @property
    def added(self) -> np.ndarray:
        """Coefficients (k,) of the columns of the effect."""
        return np.array([one.change[0] for one in self.linear])

    @property
    def linear(self) -> tuple[Value, ...]:
        return self.parameters[: len(self.judged.shaped.positive)]

    def carried_in(self, recordings: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Recordings that carry each load of an effect that differs between them, and `none`."""
        loads = self.judged.shaped.term.carried
        if not loads:
            return {}
        pairs = zip(self.parameters, loads, strict=True)
        carried = {value.name: load.recordings for value, load in pairs}
        loaded = {name for names in carried.values() for name in names}
        return carried | {NO_LOAD: tuple(sorted(set(recordings) - loaded))}


def extended(
    found: Search, before: Model, judged: Sequence[Judged], training: Training
) -> tuple[Model, list[tuple[Value, ...]]]:
    """The model with the refitted terms, and their values; raises `UndeterminedError`."""
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
    shapes = shape_std_devs(
        found, [one.shaped for one in judged], [after.theta[part] for part in own]
    )
    values = []
    for one, part, spread in zip(judged, own, shapes, strict=True):
        changes = one.shaped.candidate.changes
        linear = [
            Value(
                parameter.name,
                *_estimate(after, i),
                found.evidence.unit(parameter.unit),
                parameter.minimum,
                _estimate(before, i) if changes else None,
            )
            for i, parameter in enumerate(after.parameters[part], part.start)
        ]
        coordinate = after.setting.units.get(one.shaped.candidate.where, "rad")
        bent = [
            Value(
                name,
                float(one.shaped.shape[name]),
                spread[name],
                found.evidence.unit(shape.unit_on(coordinate)),
            )
            for name, shape in one.shaped.candidate.shapes.items()
        ]
        values.append(tuple(linear + bent))
    return after, values


def _estimate(model: Model, i: int) -> tuple[float, float]:
    """A parameter and its standard deviation."""
    assert model.std_devs is not None  # just fitted, or kept
    return float(model.theta[i]), float(model.std_devs[i])


def shape_std_devs(
    search: Search, chosen: Sequence[ShapedCandidate], values: Sequence[np.ndarray]
) -> list[dict[str, float]]:
    """Standard deviations of the nonlinear parameters of candidates, beside all else."""
    evidence, white = search.evidence, search.whitener
    keys = [(k, name) for k, one in enumerate(chosen) for name in one.candidate.shapes]
    out: list[dict[str, float]] = [{} for _ in chosen]
    slopes = []
    for k, name in keys:
        term, middle = chosen[k].term, chosen[k].shape[name]
        low, high = (
            evidence.columns(term.model_copy(update={name: middle * (1.0 + s)}))
            for s in (-STEP, STEP)
        )
        slopes.append(white((high - low) @ values[k] / (2.0 * STEP * middle)))
    if not keys:
        return out
    columns = np.concatenate([np.stack(slopes, axis=1), *(white(one.columns) for one in chosen)], 1)
    columns = beside(search.base.basis, columns)
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    gram = (columns / size).T @ (columns / size)
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(gram, rcond=1e-10)))) / size
    for (k, name), std in zip(keys, spread, strict=False):
        out[k][name] = float(std)
    return out


# A model with effects added: what it is after the fit, refitted jointly, and what it leaves.
#
# Where its values are kept, what changed is estimated alone.


@dataclass(frozen=True)
class Trial:
    """`model` is that with the `effects`, fitted; `values` are the parameters of each; `zero` are
    further effects whose parameters may as well be zero. On the training recordings: its `residual`
    (n, c), `energy` (c,) of it in units of the noise, and `left_share` of the energy beyond noise
    where the effects act.
    """

    effects: tuple[Judged, ...]
    zero: tuple[Judged, ...]
    values: tuple[tuple[Value, ...], ...]
    model: Model
    residual: np.ndarray
    energy: np.ndarray
    left_share: float
    learning: Callable[[], Learnt]
    thresholds: Thresholds

    @property
    def formless(self) -> bool:
        """Return whether no effect has a law, which would leave a rest if its form is wrong."""
        return all(one.shaped.candidate.effect.formless for one in self.effects)

    @cached_property
    def learnt(self) -> Learnt:
        """Part of the residual that could be learnt; it takes a second and more."""
        return self.learning()

    @cached_property
    def law(self) -> np.ndarray:
        """Return whether the residual of a joint (j,) is a law."""
        return self.learnt.follows_law(self.thresholds)

    def explained(self, before: "Trial") -> float:
        """Share of what can be explained of what is left `before` that the effects do."""
        learnable = np.where(self.law, self.learnt.share, 0.0)
        remaining = float((self.energy[: len(learnable)] * learnable).sum())
        own = max(float((before.energy - self.energy).sum()), 0.0)
        return own / max(own + remaining, np.finfo(float).tiny)


def tried(fit: Fitted, search: Search, effects: Sequence[Judged]) -> Trial:
    """The model with the effects that differ from zero; raises `UndeterminedError`."""
    chosen, sigmas = tuple(effects), search.thresholds.method.parameter_sigmas
    while True:
        model, values = extended(search, fit.before, chosen, fit.training)
        pairs = zip(chosen, values, strict=True)
        sure = tuple(one for one, own in pairs if differs(one, own, sigmas))
        if sure == chosen:
            break
        chosen = sure
    evidence = fit.evidence
    left = evidence.residual(model)
    beyond = evidence.residual(within(search, model)) if evidence.keeps else left
    return Trial(
        effects=chosen,
        zero=tuple(one for one in effects if one not in chosen),
        values=tuple(values),
        model=model,
        residual=left,
        energy=search.normalized_energy(left),
        left_share=search.left_share([one.shaped for one in chosen]),
        learning=lambda: learn(evidence.moving, beyond, folds(evidence.moving).fold),
        thresholds=search.thresholds,
    )


def differs(one: Judged, values: Sequence[Value], sigmas: float) -> bool:
    """Return whether a linear parameter of an effect is more than noise and than usual."""
    changes = [value.change for value in values[: len(one.shaped.positive)]]
    usual = one.shaped.candidate.effect.usual
    return any(abs(change) > max(sigmas * std_dev, usual) for change, std_dev in changes)


class Short(NamedTuple):
    """An effect that does not close the held-out gap, and why it is rejected."""

    effect: Judged
    rejection: Rejection


@dataclass(frozen=True)
class Proof:
    """The effects that close the held-out `gap` where they act, in a `trial`; `short` do not.
    `lines` are the clearest of each joint in the spectrum of what the `trial` leaves.
    """

    before: Trial
    trial: Trial
    gap: Gap
    short: tuple[Short, ...] = ()
    lines: tuple[Line, ...] = ()
    pulsations: tuple[Line, ...] = ()


def proved(
    fit: Fitted, search: Search, wanted: Sequence[Judged], progress: Progress = silent
) -> Proof:
    """The `wanted` effects without the weakest of those that fall short, one after another."""
    before, thresholds = tried(fit, search, ()), search.thresholds
    progress("what is left", 0.5)
    short: list[Short] = []
    known = unchanged(fit)
    while True:
        trial = tried(fit, search, wanted) if wanted else before
        gap = measure(fit, trial.model, thresholds.method, known)
        failing = [Short(one, why) for one in trial.effects if (why := objection(one, gap))]
        if not failing and trial.effects and (why := resemblance(trial, before)):
            failing = [Short(trial.effects[-1], why)]
        if not failing:
            break
        short.insert(0, failing[-1])
        wanted = [one for one in trial.effects if one is not failing[-1].effect]
    fewest = thresholds.method.pulsation_recordings
    lines = clearest_lines(trial.model, (*fit.evidence.runs, *fit.held_out.runs), fewest)
    progress("what is left", 1.0)
    progress("gap", 1.0)
    return Proof(before, trial, gap, tuple(short), lines, pulsations(lines, thresholds))


def resemblance(trial: Trial, before: Trial) -> Rejection | None:
    """Objection that effects leave most where they act, and explain little of the rest."""
    least = trial.thresholds.method.simple_share
    if trial.left_share <= 1.0 - least or (share := trial.explained(before)) >= least:
        return None
    return Rejection(Reason.RESEMBLANCE, share, least)


def objection(one: Judged, gap: Gap) -> Rejection | None:
    """The reason why an effect does not close the gap where it acts; None if it does."""
    own = one.shaped.joints(gap.joints)
    held_to, method = gap.held_to, gap.method
    closed, errors = held_to.closed_on(own), tuple(map(held_to.change, own))
    if not np.isfinite(closed):  # no gap that a model is known to close: it must not open one,
        ratio = held_to.after[own] / np.maximum(held_to.before[own], RESOLUTION)
        worse = (ratio > method.worse_factor) & (gap.after[own] > gap.before[own])
        still = not held_to.is_noise(own) and (ratio > 1.0 - RESOLUTION).all()  # and close some
        return Rejection(Reason.WIDENED, errors=errors) if still or worse.any() else None
    least = method.simple_share if _simple(one, method.simple_share) else method.closed_share
    return Rejection(Reason.CLOSED, closed, least, errors=errors) if closed < least else None


def _simple(one: Judged, share: float) -> bool:
    """Return whether an effect helps everywhere, and no other is nearly as good."""
    asked = one.held_out[np.isfinite(one.held_out)]
    bent = one.shaped.shape or one.shaped.candidate.drawn
    alone = not one.indistinct and (not bent or one.margin > share * one.score)
    return alone and bool((asked > 0.0).all())


def found_effect(one: Candidate) -> dict[str, str]:
    """The fields of an effect and its place in findings.json."""
    return {"effect": one.type, "name": one.effect.name, "joint": one.where}
