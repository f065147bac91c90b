"""The answer of a diagnosis: the verdict on the force, then loads, oil and pulsation beside it."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, Weighed, with_own_loads
from crane_identification.diagnosis.decision import Decision, objection
from crane_identification.diagnosis.evidence import beside, relative, residual
from crane_identification.diagnosis.findings import (
    ErrorChange,
    FoundCurve,
    NearEffect,
    NearestEffects,
    OwnTermEntry,
    UnknownPlace,
    Verdict,
)
from crane_identification.diagnosis.fit import Fitted, UndeterminedError
from crane_identification.diagnosis.flow import Flow, Flows
from crane_identification.diagnosis.formula import formula
from crane_identification.diagnosis.gap import OF_PERIODS, OF_SAMPLES, Gap, Line
from crane_identification.diagnosis.judgement import (
    Beyond,
    HeldOutChange,
    Judged,
    Reason,
    Rejection,
    all_judged,
    held_out_gains,
    helps,
)
from crane_identification.diagnosis.proof import Proof, extended, found_effect
from crane_identification.diagnosis.residuals import (
    curves_of,
    left_elsewhere,
    solved,
    unknown_force,
)
from crane_identification.diagnosis.search import (
    Search,
    detectable,
    gained,
    left_share,
    named_from,
    testable_share,
    unexplained_on_joints,
)
from crane_identification.diagnosis.selection import NOTHING, solve
from crane_identification.thresholds import Gates, Thresholds

# The verdict: from what was found, what is left of it, and what the recordings could show.

LISTED_ALTERNATIVES = 4  # members of an ambiguity group that the reason lists
NOT_HELD = "something is left that no effect of the catalogue explains"


class DifferingForm(NamedTuple):
    """An effect whose form is not that of the catalogue, and the nonparametric curves of the force
    that its form lacks.
    """

    candidate: Candidate
    curves: tuple[FoundCurve, ...]


class Answer(NamedTuple):
    """A verdict and its reason; `objection`: why effects that passed all tests are not named;
    `unknown`: what is known of an unknown force; `own`: the user's terms that are not named.
    """

    verdict: Verdict
    reason: str
    objection: str = ""
    nearest: NearestEffects | None = None
    unknown: UnknownPlace | None = None
    named_from: Mapping[str, float] = MappingProxyType({})
    own: tuple[OwnTermEntry, ...] = ()
    forms: tuple[DifferingForm, ...] = ()


class Reach(NamedTuple):
    """The share of effects that recordings can test, the least strength that shows, by joint the
    strength from which an effect is named, and the parameters that are not determined.
    """

    testable: float
    least: float
    named: Mapping[str, float]
    undetermined: Sequence[str]


def judge(
    proof: Proof,
    reach: Reach,
    thresholds: Thresholds,
    forms: Mapping[int, DifferingForm] = MappingProxyType({}),
) -> Answer:
    """The answer of the force; `forms` as of `differing_forms`."""
    gap, method = proof.gap, thresholds.method
    if proof.trial.effects:
        return _of_effects(proof, thresholds, forms)
    if proof.short:
        return Answer(Verdict.UNKNOWN, NOT_HELD, objection_told([proof.short[-1].rejection]))
    if proof.trial.zero:
        return Answer(
            Verdict.UNKNOWN,
            NOT_HELD,
            f"its parameters are zero within {method.parameter_sigmas:.0f} standard deviations, or "
            "no more than usual",
        )
    law = proof.before.law
    if law.any():
        return Answer(
            Verdict.UNKNOWN,
            f"the residual of {_listed(gap, law)} is systematic, but no effect of the catalogue "
            "explains it",
        )
    errors = gap.after, gap.training_before, thresholds.gates
    if beyond := _beyond(gap, *errors, OF_PERIODS):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    if reach.undetermined:
        return Answer(
            Verdict.INSUFFICIENT,
            f"they do not even determine {', '.join(reach.undetermined)} of the model; excite the "
            "joints more: both directions, several speeds, the whole range",
        )
    if reach.testable < method.testable_share:
        return Answer(
            Verdict.INSUFFICIENT,
            f"only {reach.testable:.0%} of the effects would show in these recordings; excite the "
            "joints more: both directions, several speeds, the whole range",
        )
    if reach.least > method.detectable_strength:
        return Answer(
            Verdict.INSUFFICIENT,
            f"of ten effects, one would not show at {reach.least:.1%} of the drive force; record "
            f"more{_better_known(gap)}",
        )
    if beyond := _beyond(gap, *errors, OF_SAMPLES):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    said = ", ".join(f"{least:.2%} on {joint}" for joint, least in reach.named.items())
    return Answer(
        Verdict.NONE,
        f"nine in ten effects would have been named from this share of the drive force on: {said}; "
        f"{_of_noise(gap)}",
    )


def _better_known(gap: Gap) -> str:
    worst = float(np.max(gap.uncertain))
    if not worst:
        return ""
    return (
        f", or keep values that are better known: their standard deviations make {worst:.1%} of "
        "the force uncertain"
    )


def _of_noise(gap: Gap) -> str:
    errors = np.maximum(gap.after, gap.training_before)
    known = np.isfinite(gap.floor)
    said = f"the force errs by {gap.over(errors, OF_SAMPLES).max():.1f} times {OF_SAMPLES}"
    if not known.any():
        return f"{said} at most; no held-out recording repeats its motion"
    largest = float(np.nan_to_num(gap.over(errors, OF_PERIODS)).max())
    return f"{said}, and by {largest:.1f} times {OF_PERIODS}, at most" + (
        "" if known.all() else f"; not known of {_listed(gap, ~known)}"
    )


def _beyond(
    gap: Gap,
    held_out: np.ndarray,
    training: np.ndarray,
    gates: Gates,
    scatter: str,
    asked: np.ndarray | bool = True,
) -> list[str]:
    """Sentences on the joints `asked` whose errors (j,) exceed the noise by the `scatter`."""
    errors = np.maximum(held_out, training)
    times = gap.over(errors, scatter)
    beyond = gap.beyond(errors, gates, scatter) & asked
    return [
        f"the force of {gap.joints[j]} errs by {held_out[j]:.2%} on held-out recordings and by "
        f"{training[j]:.2%} on the others, up to {times[j]:.0f} times {scatter}"
        for j in np.flatnonzero(beyond)
    ]


def _of_effects(proof: Proof, thresholds: Thresholds, forms: Mapping[int, DifferingForm]) -> Answer:
    """Effects that passed every test: are they all?"""
    share = proof.trial.explained(proof.before)
    said = _moved(proof)
    if np.isfinite(proof.gap.held_to.closed_on(np.flatnonzero(_acting(proof)).tolist())):
        told = np.floor(100.0 * share)  # never all, if something is left
        said.insert(0, f"the effects explain {told:.0f}% of what can be explained")
    groups = [_alternatives(one) for one in proof.trial.effects if one.indistinct]
    apart = [f"these recordings cannot tell apart: {'; '.join(groups)}"] if groups else []
    said += [
        f"the form of {one.candidate.label} differs from that of the catalogue"
        for one in forms.values()
    ]
    more = _more(proof, share, thresholds, forms)
    if more:
        return Answer(Verdict.AND_MORE, "; ".join(said + apart + more))
    if groups:
        return Answer(Verdict.AMBIGUOUS, "; ".join(apart + said))
    return Answer(Verdict.NAMED, "; ".join(said))


def _moved(proof: Proof) -> list[str]:
    gap, acting = proof.gap, _acting(proof)
    return [change_told(gap.change(j)) for j in np.flatnonzero(acting & (gap.after < gap.before))]


def _acting(proof: Proof) -> np.ndarray:
    """Return whether any of the effects acts on a joint (j,)."""
    names = proof.gap.joints
    joints = {j for one in proof.trial.effects for j in one.shaped.joints(names)}
    return np.isin(np.arange(len(names)), list(joints))


def _more(
    proof: Proof, share: float, thresholds: Thresholds, forms: Mapping[int, DifferingForm]
) -> list[str]:
    """Sentences on what is missing beside the effects. On a joint without an effect, an error just
    above its limit counts only if it is systematic.
    """
    trial, gap, method = proof.trial, proof.gap, thresholds.method
    told = np.isin(np.arange(len(gap.joints)), list(forms))  # by their forms
    systematic, acting = trial.law & ~told, _acting(proof)
    said = []
    if share < method.explained_share and systematic.any():
        said.append(f"a systematic residual is left on {_listed(gap, systematic)}")
    if trial.left_share > method.left_share and not told[acting].all():
        said.append(f"they leave {trial.left_share:.0%} of the energy beyond noise where they act")
    for scatter in (OF_PERIODS, OF_SAMPLES) if trial.formless else (OF_PERIODS,):
        errors = np.maximum(gap.after, gap.training_after)
        clear = errors / method.clean_factor
        asked = ~told & (acting | trial.law | gap.beyond(clear, thresholds.gates, scatter))
        said += _beyond(gap, gap.after, gap.training_after, thresholds.gates, scatter, asked)
        told |= asked & gap.beyond(errors, thresholds.gates, scatter)  # said once
    worse = gap.after > method.worse_factor * np.fmax(gap.before, method.clean_factor * gap.floor)
    said += [
        ("" if acting[j] else "where none of the effects acts, ") + change_told(gap.change(j))
        for j in np.flatnonzero(worse)
    ]
    said += [
        f"{one.effect.shaped.candidate.label} would go with them, "
        f"but {objection_told([one.rejection])}"
        for one in proof.short
    ]
    return said


def differing_forms(
    search: Search, effects: Sequence[Judged], thresholds: Thresholds, counts: bool = False
) -> dict[int, DifferingForm]:
    """Numbers of the joints on which a nonparametric curve of an effect explains most of what
    `effects` leave, also of recordings that it was not fitted to, with that effect.
    """
    joints, method = search.evidence.joints, thresholds.method
    subset = search.together(one.shaped for one in effects)
    if not subset.numbers:
        return {}
    left = unexplained_on_joints(search, subset)
    known = [one.shaped.columns for one in effects]
    setting, found = search.evidence.model.setting, dict[int, DifferingForm]()
    for one in effects:
        candidate = one.shaped.candidate
        curve = None if candidate.drawn else search.shapes.of(candidate)
        if curve is None or candidate.joint is None:
            continue
        j = joints.index(candidate.joint)
        if gained(search, known, curve.columns) < max(method.simple_share * left[j], one.threshold):
            continue
        gains, _ = held_out_gains(search, known, curve.columns)
        if helps(gains, thresholds):
            beside_all = np.concatenate([*known, curve.columns], axis=2)
            fit = solved(search, beside(search.base.basis, search.whitener(beside_all)))
            k = curve.columns.shape[2]
            values, std_devs = fit.values[-k:], fit.std_devs[-k:]
            curves = curves_of(curve.term, candidate.where, setting, values, std_devs, counts)
            found[j] = DifferingForm(candidate, tuple(curves))
    return found


def _alternatives(one: Judged) -> str:
    others = [member.label for member in one.indistinct]
    more = (
        f", and {len(others) - LISTED_ALTERNATIVES} more"
        if len(others) > LISTED_ALTERNATIVES
        else ""
    )
    return ", ".join([one.shaped.candidate.label, *others[:LISTED_ALTERNATIVES]]) + more


def _listed(gap: Gap, which: np.ndarray) -> str:
    return ", ".join(joint for joint, one in zip(gap.joints, which, strict=True) if one)


# The answer of a diagnosis: what the force says, then loads, oil and pulsation beside it.


def answered(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    flow: Flows,
    thresholds: Thresholds,
    own: Collection[str] = (),
) -> Answer:
    """What these results come to; of the types `own` all are reported."""
    reach, counts = _reach(fit, search, decision, thresholds), bool(fit.uncalibrated)
    forms = differing_forms(search, proof.trial.effects, thresholds, counts)
    answer = judge(proof, reach, thresholds, forms)
    if answer.verdict is not Verdict.INSUFFICIENT:  # what is left then is of the model, too
        answer = _unknown_beside(answer, [beyond_told(one) for one in decision.beyond])
    if answer.verdict is Verdict.NONE:
        answer = with_too_little(answer, decision)
    if answer.verdict is Verdict.UNKNOWN:
        answer = answer._replace(
            nearest=_nearest(fit, search, decision, proof, answer, thresholds),
            unknown=_unknown(fit, search, proof),
        )
    elif answer.verdict is Verdict.AND_MORE:
        effects = proof.trial.effects
        left = left_elsewhere(search, effects, decision.threshold, thresholds, counts)
        answer = with_left(answer, left)
    answer = with_flow(with_loads(answer, proof.gap.loads), flow.found)
    answer = with_pulsation(answer, proof.pulsations)
    terms = tuple(_own_terms(fit, search, proof, own, thresholds))
    return answer._replace(named_from=reach.named, own=terms, forms=tuple(forms.values()))


def _unknown(fit: Fitted, search: Search, proof: Proof) -> UnknownPlace:
    """The unknown force on the joint that errs most, with a formula if a short one explains it."""
    j, counts = _worst(proof), bool(fit.uncalibrated)
    found = formula(search, fit.held_out, proof.gap, j, counts)
    return unknown_force(search, j, counts).model_copy(update={"formula": found})


def _worst(proof: Proof) -> int:
    """Number of the joint whose force errs most, beyond what is noise there."""
    gap = proof.gap
    noise = np.nan_to_num(gap.method.clean_factor * gap.floor)
    return int(np.argmax(gap.largest_before**2 - np.minimum(noise, gap.largest_before) ** 2))


def _own_terms(
    fit: Fitted, search: Search, proof: Proof, own: Collection[str], thresholds: Thresholds
) -> Iterator[OwnTermEntry]:
    """The terms of the types `own` that are not named, each by itself beside the model."""
    named = {one.shaped.candidate for one in proof.trial.effects}
    short = {one.effect.shaped.candidate: objection_told([one.rejection]) for one in proof.short}
    for hidden in (search.untestable, search.unobservable):
        yield from (_own(one, why) for one, why in hidden.items() if one.type in own)
    candidates = search.projection.candidates
    for candidate in dict.fromkeys(one.candidate for one in candidates):
        if candidate.type not in own or candidate in named:
            continue
        numbers = [i for i, one in enumerate(candidates) if one.candidate == candidate]
        judged = _best_alone(search, numbers, thresholds)
        if judged is None:
            yield _own(candidate, "its parameters would have the wrong sign")
            continue
        said = short.get(candidate) or _objection(judged, thresholds)
        said = said or "what is named explains the same, or more"
        yield _own(candidate, said, nearest(fit, search, [judged], said))


def _own(one: Candidate, objection: str, tried: NearestEffects | None = None) -> OwnTermEntry:
    return OwnTermEntry(**found_effect(one), objection=objection, tried=tried)


def _objection(judged: Judged, thresholds: Thresholds) -> str:
    why = objection(judged, thresholds)
    return objection_told([why] if why else [])


def _best_alone(search: Search, numbers: Sequence[int], thresholds: Thresholds) -> Judged | None:
    """The candidate of these that explains most by itself; None if each has a wrong sign."""
    alone = [solve(search.projection, (number,)) or NOTHING for number in numbers]
    best = max(alone, key=lambda one: one.gain, default=NOTHING)
    return all_judged(search, best, thresholds)[0] if best.numbers else None


def _reach(fit: Fitted, search: Search, decision: Decision, thresholds: Thresholds) -> Reach:
    threshold, gate = decision.threshold, thresholds.gates.smallest_strength
    return Reach(
        testable_share(search),
        detectable(search, threshold),
        named_from(search, threshold, gate),
        fit.undetermined,
    )


def with_too_little(answer: Answer, decision: Decision) -> Answer:
    """That nothing is missing, and what of the catalogue is more than chance, but too little."""
    more = [one for one in decision.nearest if one.score > one.threshold]
    said = [
        f"{one.shaped.candidate.label} comes nearest, but {objection_told(decision.rejections)}"
        for one in more
    ]
    return answer._replace(reason="; ".join([answer.reason, *said]))


def _nearest(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    answer: Answer,
    thresholds: Thresholds,
) -> NearestEffects | None:
    """The effects that came furthest, on the joint that errs most."""
    worst, names = _worst(proof), search.evidence.joints
    short = tuple(one.effect for one in proof.short)
    effects = short or proof.trial.zero or decision.nearest
    said = answer.objection or objection_told(decision.rejections)
    if not any(worst in one.shaped.joints(names) for one in effects):
        candidates = search.projection.candidates
        there = [i for i, one in enumerate(candidates) if worst in one.joints(names)]
        if judged := _best_alone(search, there, thresholds):
            effects, said = (judged,), _objection(judged, thresholds) or said
    return nearest(fit, search, effects, said) if effects else None


def nearest(
    fit: Fitted, search: Search, effects: Sequence[Judged], objection: str
) -> NearestEffects:
    """The rejected `effects`, the errors of the fitted model with them, and the objection to them;
    held-out errors are NaN if the recordings do not determine the effects.
    """
    old = relative(fit.held_out, residual(fit.held_out, fit.before))
    try:
        model, _ = extended(search, fit.before, effects, fit.training)
        carried, _ = with_own_loads(model, fit.evidence, fit.held_out)
        new = relative(fit.held_out, residual(fit.held_out, carried))
    except UndeterminedError:
        new = np.full_like(old, np.nan)
    left = left_share(search, [one.shaped for one in effects])
    return NearestEffects(
        effects=[
            NearEffect(
                **found_effect(one.shaped.candidate), score=one.score, threshold=one.threshold
            )
            for one in effects
        ],
        explained_share=float(np.clip(1.0 - left, 0.0, 1.0)),
        model_error={
            joint: ErrorChange(before=before, after=after)
            for joint, before, after in zip(fit.before.joints, old, new, strict=True)
        },
        objection=objection,
    )


def with_left(answer: Answer, left: Sequence[UnknownPlace]) -> Answer:
    """The answer, and what its effects leave on joints where none of them acts, largest first."""
    if not left:
        return answer
    said = [
        f"where none of the effects acts, {one.relative_magnitude or 0.0:.2%} of the drive force "
        f"of {one.joint} are left, most like {one.signatures[0].signature}"
        for one in left
    ]
    return answer._replace(reason="; ".join([answer.reason, *said]), unknown=left[0])


def with_flow(answer: Answer, flows: Sequence[Flow]) -> Answer:
    """The answer where the flow of oil, which the torque cannot show, tells something more."""
    strange = [
        f"{flow.unexplained:.1%} of the flow of {flow.joint} is systematic, but no effect of the "
        "catalogue explains it" + (": most of it is what air in the oil takes" if flow.airy else "")
        for flow in flows
        if flow.unknown
    ]
    missing = [
        f"{one.effect.name} of {flow.joint} is beyond {one.limit}"
        + (", more at some places of the stroke than at others" if one.along_stroke else "")
        for flow in flows
        for one in flow.missing
    ]
    return _named_beside(_unknown_beside(answer, strange), missing)


def with_pulsation(answer: Answer, pulsations: Sequence[Line]) -> Answer:
    """The answer where a line is in the force that no motion makes."""
    return _unknown_beside(
        answer,
        [
            f"the force of {one.joint} pulsates at {one.frequency:.2f} Hz in all recordings "
            f"({one.relative_magnitude:.1%} of it), which no effect of the catalogue does"
            for one in pulsations
        ],
    )


def _unknown_beside(answer: Answer, said: Sequence[str]) -> Answer:
    """The answer, and something that the catalogue does not hold."""
    if not said:
        return answer
    text = "; ".join(said)
    if answer.verdict is Verdict.NONE:
        return Answer(Verdict.UNKNOWN, text)
    if answer.verdict is Verdict.INSUFFICIENT:  # what shows, shows
        return Answer(Verdict.UNKNOWN, f"{text}; {answer.reason}")
    more = answer.verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    verdict = Verdict.AND_MORE if more else answer.verdict
    return answer._replace(verdict=verdict, reason=f"{answer.reason}; {text}")


def _named_beside(answer: Answer, said: Sequence[str]) -> Answer:
    if not said:
        return answer
    text = "; ".join(said)
    if answer.verdict in (Verdict.NONE, Verdict.INSUFFICIENT):
        return Answer(Verdict.NAMED, text)
    unknown = answer.verdict is Verdict.UNKNOWN
    verdict = Verdict.AND_MORE if unknown else answer.verdict
    return answer._replace(verdict=verdict, reason=f"{answer.reason}; {text}")


def with_loads(answer: Answer, loads: Sequence[Weighed]) -> Answer:
    """The answer where a held-out recording carries another load than all those trained on."""
    said = [
        f"{one.recording} carries {abs(one.mass):.3g} kg {'more' if one.mass > 0.0 else 'less'} "
        "than the recordings trained on"
        for one in loads
        if one.found
    ]
    return _named_beside(answer, said)


# Why an effect is rejected, and what the catalogue does not hold.


def objection_told(rejections: Sequence[Rejection]) -> str:
    """Why an effect is rejected, in words; empty if it is not."""
    return "; ".join(_rejected(one) for one in rejections)


def _rejected(one: Rejection) -> str:
    about, limit = ", ".join(one.about), one.limit
    with_it = f"with it, {', '.join(change_told(change) for change in one.errors)}"
    match one.reason:
        case Reason.SCORE:
            return f"its score is {one.measured:.0f}, and {limit:.0f} is asked for"
        case Reason.STRENGTH:
            return (
                f"it is {one.measured:.2g} of the drive force, where the errors of the processing "
                f"itself reach {limit:.2g}"
            )
        case Reason.HELD_OUT:
            return (
                f"it improves the prediction of {one.measured:.0f} of the {limit:.0f} parts that "
                "it was not fitted to"
            )
        case Reason.FORM:
            return "one of them is but the form of another one"
        case Reason.RIVALS:
            return f"others that look different are as good as {about}"
        case Reason.SIGNATURE:
            return f"{about} explains clearly more than any shape of it"
        case Reason.CLOSED if one.measured < 0.0:
            return f"{with_it}; it should close {limit:.0%} of the gap"
        case Reason.CLOSED:
            return (
                f"it closes {one.measured:.0%} of what could be closed of the gap on held-out "
                f"recordings, and {limit:.0%} are asked for"
            )
        case Reason.RESEMBLANCE:
            return (
                f"it explains {one.measured:.0%} of what can be explained, and {limit:.0%} are "
                "asked for"
            )
        case Reason.WIDENED:
            return with_it


def change_told(change: HeldOutChange) -> str:
    """Sentence on the change of the held-out error of a joint; one number if both are printed
    alike.
    """
    before, after = (f"{error:.2%}" for error in (change.before, change.after))
    if before == after:
        return f"the held-out error of {change.joint} stays at {after}"
    verb = "falls" if change.after < change.before else "rises"
    return f"the held-out error of {change.joint} {verb} from {before} to {after}"


def beyond_told(one: Beyond) -> str:
    """Sentence on what the catalogue does not hold."""
    if one.effects:
        rejected = objection_told(one.rejections)
        return f"{', '.join(one.effects)} explains more than chance does, but {rejected}"
    return f"on {one.joint} there is {one.signature}, as of no effect of the catalogue"
