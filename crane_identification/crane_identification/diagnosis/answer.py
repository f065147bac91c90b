"""The answer of a diagnosis: the verdict on the force, then loads, oil and pulsation beside it."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis import findings as schema
from crane_identification.diagnosis.candidates import Candidate, Weighed, with_own_loads
from crane_identification.diagnosis.decision import Decision, objection
from crane_identification.diagnosis.findings import Verdict
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
    predicts,
)
from crane_identification.diagnosis.projection import NOTHING, solve
from crane_identification.diagnosis.proof import Proof, extended, found_effect
from crane_identification.diagnosis.residuals import (
    curves_of,
    left_elsewhere,
    solved,
    unknown_force,
)
from crane_identification.diagnosis.search import Search

# The verdict: from what was found, what is left of it, and what the recordings could show.

LISTED_ALTERNATIVES = 4  # members of an ambiguity group that the reason lists
NOT_HELD = "something is left that no effect of the catalogue explains"
EXCITE = "excite the joints more: both directions, several speeds, the whole range"


class DifferingForm(NamedTuple):
    """An effect of another form than the catalogue's, and curves of the force that it lacks."""

    candidate: Candidate
    curves: list[schema.FoundCurve]


class Answer(NamedTuple):
    """A verdict and its reason; `objection`: why effects that passed all tests are not named;
    `unknown`: what is known of an unknown force; `own`: the user's terms that are not named.
    """

    verdict: Verdict
    reason: str
    objection: str = ""
    nearest: schema.NearestEffects | None = None
    unknown: schema.UnknownPlace | None = None
    named_from: Mapping[str, float] = MappingProxyType({})
    own: tuple[schema.OwnTermEntry, ...] = ()
    forms: tuple[DifferingForm, ...] = ()


class Reach(NamedTuple):
    """The share of effects that recordings can test, the least strength that shows, by joint the
    strength from which an effect is named, and the parameters that are not determined.
    """

    testable: float
    least: float
    named: Mapping[str, float]
    undetermined: Sequence[str]


Forms = Mapping[int, DifferingForm]


def judge(proof: Proof, reach: Reach, forms: Forms = MappingProxyType({})) -> Answer:
    """The answer of the force; `forms` as of `differing_forms`."""
    gap, method = proof.gap, proof.gap.method
    if proof.trial.effects:
        return _of_effects(proof, forms)
    if proof.short:
        return Answer(Verdict.UNKNOWN, NOT_HELD, objection_told([proof.short[-1].rejection]))
    if proof.trial.zero:
        sigmas = f"{method.parameter_sigmas:.0f} standard deviations"
        why = f"its parameters are zero within {sigmas}, or no more than usual"
        return Answer(Verdict.UNKNOWN, NOT_HELD, why)
    law = proof.before.law
    if law.any():
        said = f"the residual of {_listed(gap, law)} is systematic, but no effect of the catalogue "
        return Answer(Verdict.UNKNOWN, said + "explains it")
    if beyond := _beyond(proof, gap.training_before, OF_PERIODS):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    lacking = ""
    if reach.undetermined:
        lacking = f"they do not even determine {', '.join(reach.undetermined)} of the model; "
        lacking += EXCITE
    elif reach.testable < method.testable_share:
        lacking = f"only {reach.testable:.0%} of the effects would show in these recordings; "
        lacking += EXCITE
    elif reach.least > method.detectable_strength:
        lacking = f"of ten effects, one would not show at {reach.least:.1%} of the drive force; "
        lacking += "record more"
        if worst := float(np.max(gap.uncertain)):
            lacking += (
                ", or keep values that are better known: their standard deviations make "
                f"{worst:.1%} of the force uncertain"
            )
    if lacking:
        return Answer(Verdict.INSUFFICIENT, lacking)
    if beyond := _beyond(proof, gap.training_before, OF_SAMPLES):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    said = ", ".join(f"{least:.2%} on {joint}" for joint, least in reach.named.items())
    return Answer(
        Verdict.NONE,
        f"nine in ten effects would have been named from this share of the drive force on: {said}; "
        f"{_of_noise(gap)}",
    )


def _of_noise(gap: Gap) -> str:
    errors = np.maximum(gap.after, gap.training_before)
    known = np.isfinite(gap.floor)
    said = f"the force errs by {gap.over(errors, OF_SAMPLES).max():.1f} times {OF_SAMPLES}"
    if not known.any():
        return f"{said} at most; no held-out recording repeats its motion"
    largest = float(np.nan_to_num(gap.over(errors, OF_PERIODS)).max())
    rest = "" if known.all() else f"; not known of {_listed(gap, ~known)}"
    return f"{said}, and by {largest:.1f} times {OF_PERIODS}, at most{rest}"


def _beyond(
    proof: Proof, training: np.ndarray, scatter: str, asked: np.ndarray | bool = True
) -> list[str]:
    """Sentences on the joints `asked` whose errors exceed the noise by the `scatter`."""
    gap = proof.gap
    errors = np.maximum(gap.after, training)
    times = gap.over(errors, scatter)
    return [
        f"the force of {gap.joints[j]} errs by {gap.after[j]:.2%} on held-out recordings and by "
        f"{training[j]:.2%} on the others, up to {times[j]:.0f} times {scatter}"
        for j in np.flatnonzero(gap.beyond(errors, proof.trial.thresholds.gates, scatter) & asked)
    ]


def _of_effects(proof: Proof, forms: Forms) -> Answer:
    """The answer with effects that passed every test: are they all?"""
    gap, acting = proof.gap, _acting(proof)
    share = proof.trial.explained(proof.before)
    said = [change_told(gap.change(j)) for j in np.flatnonzero(acting & (gap.after < gap.before))]
    if np.isfinite(gap.held_to.closed_on(np.flatnonzero(acting).tolist())):
        told = np.floor(100.0 * share)  # never all, if something is left
        said.insert(0, f"the effects explain {told:.0f}% of what can be explained")
    groups = [_alternatives(one) for one in proof.trial.effects if one.indistinct]
    apart = [f"these recordings do not discriminate: {'; '.join(groups)}"] if groups else []
    said += [
        f"the form of {one.candidate.label} differs from that of the catalogue"
        for one in forms.values()
    ]
    if more := _more(proof, share, forms):
        return Answer(Verdict.AND_MORE, "; ".join(said + apart + more))
    if groups:
        return Answer(Verdict.AMBIGUOUS, "; ".join(apart + said))
    return Answer(Verdict.NAMED, "; ".join(said))


def _acting(proof: Proof) -> np.ndarray:
    """Return whether any of the effects acts on a joint (j,)."""
    names = proof.gap.joints
    joints = {j for one in proof.trial.effects for j in one.shaped.joints(names)}
    return np.isin(np.arange(len(names)), list(joints))


def _more(proof: Proof, share: float, forms: Forms) -> list[str]:
    """Sentences on the error that the effects leave; small errors count if systematic."""
    trial, gap, method = proof.trial, proof.gap, proof.gap.method
    gates = trial.thresholds.gates
    told = np.isin(np.arange(len(gap.joints)), list(forms))  # by their forms
    systematic, acting = trial.law & ~told, _acting(proof)
    said = []
    if share < method.explained_share and systematic.any():
        said.append(f"a systematic residual is left on {_listed(gap, systematic)}")
    if trial.left_share > method.left_share and not told[acting].all():
        said.append(f"they leave {trial.left_share:.0%} of the energy beyond noise where they act")
    errors = np.maximum(gap.after, gap.training_after)
    for scatter in (OF_PERIODS, OF_SAMPLES) if trial.formless else (OF_PERIODS,):
        clear = gap.beyond(errors / method.clean_factor, gates, scatter)
        asked = ~told & (acting | trial.law | clear)
        said += _beyond(proof, gap.training_after, scatter, asked)
        told |= asked & gap.beyond(errors, gates, scatter)  # said once
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


def differing_forms(search: Search, effects: Sequence[Judged]) -> dict[int, DifferingForm]:
    """By joint number, curves of effects that explain most of what these leave, also held out."""
    evidence, share = search.evidence, search.thresholds.method.simple_share
    subset, found = search.together(one.shaped for one in effects), dict[int, DifferingForm]()
    left = search.unexplained_on_joints(subset)
    known = [one.shaped.columns for one in effects]
    for one in effects if subset.numbers else ():
        candidate = one.shaped.candidate
        curve = None if candidate.drawn else search.shapes.of(candidate)
        if curve is None or candidate.joint is None:
            continue
        j = evidence.joints.index(candidate.joint)
        least = max(share * left[j], one.threshold)
        if search.gained(known, curve.columns) >= least and predicts(search, known, curve.columns):
            fit, k = solved(search, search.beside(*known, curve.columns)), curve.columns.shape[2]
            curves = curves_of(evidence, curve.term, fit.values[-k:], fit.std_devs[-k:])
            found[j] = DifferingForm(candidate, curves)
    return found


def _alternatives(one: Judged) -> str:
    others = [member.label for member in one.indistinct]
    more = len(others) - LISTED_ALTERNATIVES
    listed = ", ".join([one.shaped.candidate.label, *others[:LISTED_ALTERNATIVES]])
    return listed + (f", and {more} more" if more > 0 else "")


def _listed(gap: Gap, which: np.ndarray) -> str:
    return ", ".join(joint for joint, one in zip(gap.joints, which, strict=True) if one)


# The answer of a diagnosis: what the force says, then loads, oil and pulsation beside it.


def answered(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    flow: Flows,
    own: Collection[str] = (),
) -> Answer:
    """The answer of all results; of the types `own` all are reported."""
    effects, threshold = proof.trial.effects, decision.threshold
    reach = Reach(
        search.testable_share,
        search.detectable(threshold),
        search.named_from(threshold),
        fit.undetermined,
    )
    forms = differing_forms(search, effects)
    answer = judge(proof, reach, forms)
    if answer.verdict is not Verdict.INSUFFICIENT:  # what is left then is of the model, too
        beyond = [beyond_told(one) for one in decision.beyond]
        answer = _beside(answer, beyond, Verdict.UNKNOWN)
    if answer.verdict is Verdict.NONE:
        answer = with_too_little(answer, decision)
    if answer.verdict is Verdict.UNKNOWN:
        answer = answer._replace(
            nearest=_nearest(fit, search, decision, proof, answer),
            unknown=_unknown(fit, search, proof.gap),
        )
    elif answer.verdict is Verdict.AND_MORE:
        answer = with_left(answer, left_elsewhere(search, effects, threshold))
    answer = with_flow(with_loads(answer, proof.gap.loads), flow.found)
    answer = with_pulsation(answer, proof.pulsations)
    terms = tuple(_own_terms(fit, search, proof, own))
    return answer._replace(named_from=reach.named, own=terms, forms=tuple(forms.values()))


def _unknown(fit: Fitted, search: Search, gap: Gap) -> schema.UnknownPlace:
    """The unknown force on the joint that errs most, with a formula if a short one explains it."""
    j = gap.worst
    found = formula(search, fit.held_out, gap, j)
    return unknown_force(search, j).model_copy(update={"formula": found})


def _own_terms(
    fit: Fitted, search: Search, proof: Proof, own: Collection[str]
) -> Iterator[schema.OwnTermEntry]:
    """The terms of the types `own` that are not named, each by itself beside the model."""

    def entry(
        one: Candidate, said: str, tried: schema.NearestEffects | None = None
    ) -> schema.OwnTermEntry:
        return schema.OwnTermEntry(**found_effect(one), objection=said, tried=tried)

    named = {one.shaped.candidate for one in proof.trial.effects}
    short = {one.effect.shaped.candidate: objection_told([one.rejection]) for one in proof.short}
    for hidden in (search.untestable, search.unobservable):
        yield from (entry(one, why) for one, why in hidden.items() if one.type in own)
    candidates = search.projection.candidates
    for candidate in dict.fromkeys(one.candidate for one in candidates):
        if candidate.type not in own or candidate in named:
            continue
        judged = _best_alone(
            search, [i for i, one in enumerate(candidates) if one.candidate == candidate]
        )
        if judged is None:
            yield entry(candidate, "its parameters would have the wrong sign")
            continue
        said = short.get(candidate) or _objection(search, judged)
        said = said or "the named effects explain the same, or more"
        yield entry(candidate, said, nearest(fit, search, [judged], said))


def _objection(search: Search, judged: Judged) -> str:
    why = objection(judged, search.thresholds)
    return objection_told([why] if why else [])


def _best_alone(search: Search, numbers: Sequence[int]) -> Judged | None:
    """The candidate of these that explains most by itself; None if each has a wrong sign."""
    alone = [solve(search.projection, (number,)) or NOTHING for number in numbers]
    best = max(alone, key=lambda one: one.gain, default=NOTHING)
    return all_judged(search, best)[0] if best.numbers else None


def with_too_little(answer: Answer, decision: Decision) -> Answer:
    """The answer, and effects of the catalogue that are more than chance, but too little."""
    said = [
        f"{one.shaped.candidate.label} comes nearest, but {objection_told(decision.rejections)}"
        for one in decision.nearest
        if one.score > one.threshold
    ]
    return answer._replace(reason="; ".join([answer.reason, *said]))


def _nearest(
    fit: Fitted, search: Search, decision: Decision, proof: Proof, answer: Answer
) -> schema.NearestEffects | None:
    """The effects that came furthest, on the joint that errs most."""
    worst, names = proof.gap.worst, search.evidence.joints
    effects = tuple(one.effect for one in proof.short) or proof.trial.zero or decision.nearest
    said = answer.objection or objection_told(decision.rejections)
    if not any(worst in one.shaped.joints(names) for one in effects):
        candidates = search.projection.candidates
        there = [i for i, one in enumerate(candidates) if worst in one.joints(names)]
        if judged := _best_alone(search, there):
            effects, said = (judged,), _objection(search, judged) or said
    return nearest(fit, search, effects, said) if effects else None


def nearest(
    fit: Fitted, search: Search, effects: Sequence[Judged], objection: str
) -> schema.NearestEffects:
    """The rejected `effects`, the errors of the fitted model with them, and the objection to them;
    held-out errors are NaN if the recordings do not determine the effects.
    """
    held_out, shaped = fit.held_out, [one.shaped for one in effects]
    old = held_out.relative(held_out.residual(fit.before))
    try:
        model, _ = extended(search, fit.before, effects, fit.training)
        carried, _ = with_own_loads(model, fit.evidence, held_out)
        new = held_out.relative(held_out.residual(carried))
    except UndeterminedError:
        new = np.full_like(old, np.nan)
    return schema.NearestEffects(
        effects=[
            schema.NearEffect(
                **found_effect(one.shaped.candidate), score=one.score, threshold=one.threshold
            )
            for one in effects
        ],
        explained_share=float(np.clip(1.0 - search.left_share(shaped), 0.0, 1.0)),
        model_error={
            joint: schema.ErrorChange(before=before, after=after)
            for joint, before, after in zip(fit.before.joints, old, new, strict=True)
        },
        objection=objection,
    )


def with_left(answer: Answer, left: Sequence[schema.UnknownPlace]) -> Answer:
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
    """The answer with what the flow of oil, which the torque cannot show, tells beside it."""
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
    return _beside(_beside(answer, strange, Verdict.UNKNOWN), missing, Verdict.NAMED)


def with_pulsation(answer: Answer, pulsations: Sequence[Line]) -> Answer:
    """The answer with lines in the spectrum of the force that no motion makes."""
    said = [
        f"the force of {one.joint} pulsates at {one.frequency:.2f} Hz in all recordings "
        f"({one.relative_magnitude:.1%} of it), which no effect of the catalogue does"
        for one in pulsations
    ]
    return _beside(answer, said, Verdict.UNKNOWN)


def with_loads(answer: Answer, loads: Sequence[Weighed]) -> Answer:
    """The answer with held-out recordings that carry another load than all those trained on."""
    said = [
        f"{one.recording} carries {abs(one.mass):.3g} kg {'more' if one.mass > 0.0 else 'less'} "
        "than the training recordings"
        for one in loads
        if one.found
    ]
    return _beside(answer, said, Verdict.NAMED)


def _beside(answer: Answer, said: Sequence[str], alone: Verdict) -> Answer:
    """The answer with something beside it that by itself would be `NAMED` or `UNKNOWN`."""
    if not said:
        return answer
    verdict, unknown = answer.verdict, alone is Verdict.UNKNOWN
    if verdict is Verdict.INSUFFICIENT and unknown:  # what shows, shows
        return Answer(alone, "; ".join([*said, answer.reason]))
    if verdict in (Verdict.NONE, Verdict.INSUFFICIENT):
        return Answer(alone, "; ".join(said))
    if verdict in ((Verdict.NAMED, Verdict.AMBIGUOUS) if unknown else (Verdict.UNKNOWN,)):
        verdict = Verdict.AND_MORE
    return answer._replace(verdict=verdict, reason="; ".join([answer.reason, *said]))


# Why an effect is rejected, and what the catalogue does not hold.


def objection_told(rejections: Sequence[Rejection]) -> str:
    """Sentences on why an effect is rejected; empty if it is not."""
    return "; ".join(_rejected(one) for one in rejections)


def _rejected(one: Rejection) -> str:
    about, limit, measured = ", ".join(one.about), one.limit, one.measured
    with_it = f"with it, {', '.join(change_told(change) for change in one.errors)}"
    match one.reason:
        case Reason.SCORE:
            return f"its score is {measured:.0f}, and {limit:.0f} is required"
        case Reason.STRENGTH:
            return (
                f"it is {measured:.2g} of the drive force, where the errors of the processing "
                f"itself reach {limit:.2g}"
            )
        case Reason.HELD_OUT:
            return (
                f"it improves the prediction of {measured:.0f} of the {limit:.0f} parts that "
                "it was not fitted to"
            )
        case Reason.FORM:
            return "one of them is only another form of a stronger one"
        case Reason.RIVALS:
            return f"effects with other signatures are as good as {about}"
        case Reason.SIGNATURE:
            return f"{about} explains clearly more than any form of it"
        case Reason.CLOSED if measured < 0.0:
            return f"{with_it}; it should remove {limit:.0%} of the model error"
        case Reason.CLOSED:
            return (
                f"it removes {measured:.0%} of the explainable model error on held-out "
                f"recordings, and {limit:.0%} are required"
            )
        case Reason.RESEMBLANCE:
            explained = f"it explains {measured:.0%} of what can be explained"
            return f"{explained}, and {limit:.0%} are required"
        case Reason.WIDENED:
            return with_it


def change_told(change: HeldOutChange) -> str:
    """Sentence on the change of the held-out error of a joint."""
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
    return f"on {one.joint} there is {one.signature}, which no effect of the catalogue has"
