"""Sentences that a reader must know before trusting a fit."""

from collections.abc import Sequence

import numpy as np

from crane_identification.data.log import Log
from crane_identification.estimation.prior_check import CHANGED, ParameterChange, PriorConflict
from crane_identification.fitting import FitResult
from crane_identification.notation import (
    NONE,
    is_determined,
    listed,
    plain,
    short_percent,
    shown,
    spoken,
    with_uncertainty,
)
from crane_identification.preparation.run import Preparation
from crane_identification.report.content import IdentificationReport, pooled
from crane_identification.validation.force_validation import Validation, elsewhere, undetermined
from crane_model.terms import Parameter

UNCERTAIN = 0.1
"""Relative standard deviation above which a parameter counts as uncertain."""
RESTING = 0.5
"""A joint that moves for less than this share of the time is weakly excited."""
RESTING_SPEED_SHARE, FASTEST_QUANTILE = 0.05, 0.99
"""A joint rests below this share of its speed at this quantile."""
BEYOND_NOISE = 1e-3
"""Probability of the noise doing what is seen, below which it is said that something else does."""
TYPICAL_CHANGES = 5
"""So many changes are named, the others counted."""
REMAINDER = 0.05
"""Share of a period that may be lost at the ends of a recording without a word."""
TYPICAL_BAGS = 3  # as many are named; more are counted


def findings(
    fit: FitResult, logs: Sequence[Log], validations: Sequence[Validation] = ()
) -> tuple[str, ...]:
    """Warnings about a fit, its recordings (`logs`: all of them) and its validation."""
    preparations = (*fit.preparations, *(v.preparation for v in validations))
    setting = fit.model.setting
    alone = fit.prior is None
    unsure = undetermined(fit.rows, fit.estimate.relative_error, fit.preparations) if alone else ""
    units = [setting.force_unit(joint) for joint in fit.model.joints]
    return (
        *(_contradicted(fit.conflict) if fit.conflict else ()),
        *_parameters(fit),
        *_standing(fit),
        *(warning for log in logs for warning in log.warnings),
        *_together([(p.source, note) for p in preparations for note in _preparation(p)]),
        *_drifts(preparations, units),
        *_lack_of_fit(fit),
        *_excitation(fit),
        *([unsure] if unsure else _elsewhere(fit, validations)),
        *([] if validations else ["No recording was held out: the model is not validated."]),
    )


def _standing(fit: FitResult) -> list[str]:
    if not fit.standing:
        return []
    return [
        f"No joint of the model moves in {listed(fit.standing)}: these recordings do not "
        "contribute to the mechanics."
    ]


def _parameters(fit: FitResult) -> list[str]:
    estimate = fit.estimate
    notes = []
    if estimate.undetermined:
        notes.append(
            f"Not determined by these recordings: {listed(estimate.undetermined)}. Only "
            "combinations of these parameters are seen; excite the joints more."
        )
    notes += [
        f"Not physical: {parameter.name} is {plain(value)} {parameter.unit}, below "
        f"{plain(parameter.minimum)}."
        for parameter, value in zip(fit.model.parameters, estimate.values.tolist(), strict=True)
        if parameter.minimum is not None and value < parameter.minimum
    ]
    if estimate.bounds:
        notes.append(
            f"Least squares alone is not physical: constrained by {listed(estimate.bounds)}."
        )
    relative = estimate.relative_std_devs
    doubtful = [
        f"{parameter.name} ({_doubt(parameter, float(value), float(std_dev))})"
        for parameter, value, std_dev, share in zip(
            fit.model.parameters, estimate.values, estimate.std_devs, relative, strict=True
        )
        if share > UNCERTAIN
    ]
    if doubtful:
        notes.append(
            f"Standard deviation above {short_percent(UNCERTAIN)} of the value: {listed(doubtful)}."
        )
    return notes


def _contradicted(conflict: PriorConflict) -> list[str]:
    notes = []
    for contradiction in conflict.contradictions:
        known = f" ({contradiction.known})" if contradiction.known else ""
        mean = (
            f", root mean square of {contradiction.freedom} values"
            if contradiction.freedom > 1
            else ""
        )
        notes.append(
            f"The recordings contradict the prior of {contradiction.entry}{known} by "
            f"{plain(contradiction.sigmas)} σ{mean}. Without it: "
            f"{_changes(contradiction.changes)}. Correct it, or widen its standard deviation."
        )
    if (count := len(notes)) > 1:
        notes.append(f"Without these {count} priors: {_changes(conflict.changes)}.")
    return notes


def _changes(changes: Sequence[ParameterChange]) -> str:
    """The largest changes in words."""
    if not changes:
        return (
            f"no parameter moves by more than {plain(CHANGED)} σ, as the recordings or other "
            "priors determine them"
        )
    parts = []
    for change in changes[:TYPICAL_CHANGES]:
        value, std_dev = with_uncertainty(change.without, change.std_dev)
        parts.append(
            f"{change.parameter} {value} ± {std_dev} {change.unit} instead of "
            f"{plain(change.with_entry, 4)}"
        )
    more = len(changes) - TYPICAL_CHANGES
    return listed(parts if more <= 0 else [*parts, f"{more} more"])


def _doubt(parameter: Parameter, value: float, std_dev: float) -> str:
    """The relative standard deviation of an uncertain estimate, or what is known instead."""
    printed = shown(value, std_dev, parameter.minimum)
    if printed.relative == NONE:
        return printed.value
    return short_percent(std_dev / abs(value)) if std_dev <= abs(value) else printed.relative


def _together(notes: Sequence[tuple[str, str]]) -> list[str]:
    """Each note once, behind the recordings that it is about."""
    sources: dict[str, list[str]] = {}
    for source, note in notes:
        sources.setdefault(note, []).append(source)
    return [f"{listed(about)}: {note}" for note, about in sources.items()]


def _preparation(preparation: Preparation) -> list[str]:
    averaging = preparation.averaging
    if averaging is None:
        if not preparation.changing:
            return []
        change = short_percent(preparation.changing)
        return [f"not averaged: the force changes by {change} of its rms from period to period."]
    notes = []
    if averaging.incomplete > REMAINDER * averaging.period:
        notes.append(
            f"{plain(averaging.incomplete)} s fill no whole period of "
            f"{plain(averaging.period)} s and are not used."
        )
    if averaging.transient:
        notes.append(
            f"{averaging.transient} of {averaging.transient + averaging.used} periods "
            "left out at the start: not periodic yet."
        )
    if averaging.used == 1:
        notes.append("only one period, so that its noise is not known.")
    return notes


def _drifts(preparations: Sequence[Preparation], units: Sequence[str]) -> list[str]:
    """One note a joint, however many recordings drift."""
    notes = []
    for j, unit in enumerate(units):
        rates = {
            p.source: float(p.averaging.drift.rate[j])
            for p in preparations
            if p.averaging is not None and p.averaging.drift.p_value[j] < BEYOND_NOISE
        }
        if rates:
            which = max(rates, key=lambda source: rates[source])
            also = f"; so it does in {len(rates)} recordings" if len(rates) > 1 else ""
            notes.append(
                f"{which}: the force of the {spoken(preparations[0].record.joints[j])} drifts by "
                f"{plain(rates[which])} {unit} a period{also}."
            )
    return notes


def _lack_of_fit(fit: FitResult) -> list[str]:
    left = fit.lack_of_fit
    return [
        f"More than noise is left in the residual of the {spoken(joint)}: {plain(float(ratio))} "
        f"times its power. The model lacks an effect, or the motion is not known well enough."
        for joint, ratio, p_value in zip(left.joints, left.ratio, left.p_value, strict=True)
        if p_value < BEYOND_NOISE
    ]


def _excitation(fit: FitResult) -> list[str]:
    share = np.concatenate([_in_motion(p) for p in fit.preparations]).mean(axis=0)
    return [
        f"Weak excitation: {spoken(joint)} moves in only {short_percent(float(moving))} of the "
        "training data; excite it more."
        for joint, moving in zip(fit.model.joints, share, strict=True)
        if moving < RESTING
    ]


def _in_motion(preparation: Preparation) -> np.ndarray:
    """(n, j): where joints move, reversals included: friction of a coupled wrist leaves out those
    of each of its motors, and rows between them are few.
    """
    speed = np.abs(preparation.record.velocity)
    least = RESTING_SPEED_SHARE * np.quantile(speed, FASTEST_QUANTILE, axis=0)
    return np.asarray((speed > least) & preparation.signed.any(axis=0))


def _elsewhere(fit: FitResult, validations: Sequence[Validation]) -> tuple[str, ...]:
    """Joints whose force the model predicts clearly worse where it was not fitted."""
    if not validations:
        return ()
    there = pooled(fit.model, validations)
    trained = fit.estimate.relative_error
    return elsewhere(fit.model.joints, there.moving, trained, there.noise_floor)


# The result in a few plain sentences.


def verdict(report: IdentificationReport) -> str:
    """Held-out errors against noise floors, and how many parameters are known how well."""
    return f"{_errors(report)} {_parameters_told(report)}"


def bags(sources: Sequence[str]) -> str:
    """Names of a few recordings, the number of many."""
    if len(sources) <= TYPICAL_BAGS:
        return listed(list(sources))
    return f"{len(sources)} recordings ({sources[0]} … {sources[-1]})"


def _errors(report: IdentificationReport) -> str:
    held_out, joints = report.held_out, report.fit.model.joints
    if held_out is None:
        return "The model has not been validated: no recording was held out."
    parts = []
    for j, joint in enumerate(joints):
        floor = float(held_out.noise_floor[j])
        noise = f"noise {short_percent(floor)}" if np.isfinite(floor) else "noise not known"
        parts.append(
            f"{short_percent(float(held_out.relative[j]))} at the {spoken(joint)} ({noise})"
        )
    return (
        "On data that the fit has not seen, predicted and measured force differ by "
        f"{listed(parts)}."
    )


def _parameters_told(report: IdentificationReport) -> str:
    estimate, parameters = report.fit.estimate, report.fit.model.parameters
    count = len(parameters)
    determined = sum(
        is_determined(float(value), float(std_dev), parameter.minimum)
        for parameter, value, std_dev in zip(
            parameters, estimate.values, estimate.std_devs, strict=True
        )
    )
    certain = int((estimate.relative_std_devs <= UNCERTAIN).sum())
    which = f"All {count}" if determined == count else f"{determined} of {count}"
    better = "all" if certain == determined else f"{certain}"
    return (
        f"{which} parameters are determined, {better} of them to "
        f"{short_percent(UNCERTAIN)} or better."
    )
