"""The answer of a diagnosis: what the force says, then loads, oil and pulsation beside it."""

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from crane_identification.diagnosis.answer.unknown import (
    UnknownForce,
    left_elsewhere,
    unknown_force,
)
from crane_identification.diagnosis.answer.verdict import (
    Answer,
    OwnTerm,
    Reach,
    Verdict,
    judge,
)
from crane_identification.diagnosis.decision.decision import Decision, objection
from crane_identification.diagnosis.decision.judgement import Judged, all_judged
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.flow.flow import Flow, Flows
from crane_identification.diagnosis.proof.proof import Nearest, Proof, nearest
from crane_identification.diagnosis.proof.pulsation import Pulsation
from crane_identification.diagnosis.search.energy import (
    detectable,
    named_from,
    testable_share,
)
from crane_identification.diagnosis.search.loads import Weighed
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import NOTHING, solve
from crane_identification.thresholds import Thresholds


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
    reach = _reach(fit, search, decision, thresholds)
    answer = judge(proof, reach, thresholds)
    if answer.verdict is not Verdict.INSUFFICIENT:  # what is left then is of the model, too
        answer = _unknown_beside(answer, decision.beyond)
    if answer.verdict is Verdict.NONE:
        answer = with_too_little(answer, decision)
    if answer.verdict is Verdict.UNKNOWN:
        answer = answer._replace(
            nearest=_nearest(fit, search, decision, proof, answer, thresholds),
            unknown=unknown_force(search, _worst(proof)),
        )
    elif answer.verdict is Verdict.AND_MORE:
        effects = proof.trial.effects
        left = left_elsewhere(search, effects, decision.threshold, thresholds)
        answer = with_left(answer, left)
    answer = with_flow(with_loads(answer, proof.gap.loads), flow.found)
    answer = with_pulsation(answer, proof.pulsations)
    terms = tuple(_own_terms(fit, search, proof, own, thresholds))
    return answer._replace(named_from=reach.named, own=terms)


def _worst(proof: Proof) -> int:
    """Number of the joint whose force errs most, beyond what is noise there."""
    gap = proof.gap
    noise = np.nan_to_num(gap.method.clean_factor * gap.floor)
    return int(np.argmax(gap.largest_before**2 - np.minimum(noise, gap.largest_before) ** 2))


def _own_terms(
    fit: Fitted, search: Search, proof: Proof, own: Collection[str], thresholds: Thresholds
) -> Iterator[OwnTerm]:
    """The terms of the types `own` that are not named, each by itself beside the model."""
    named = {one.shaped.candidate for one in proof.trial.effects}
    short = {one.effect.shaped.candidate: one.objection for one in proof.short}
    for hidden in (search.untestable, search.unobservable):
        yield from (OwnTerm(one, why) for one, why in hidden.items() if one.type in own)
    candidates = search.projection.candidates
    for candidate in dict.fromkeys(one.candidate for one in candidates):
        if candidate.type not in own or candidate in named:
            continue
        numbers = [i for i, one in enumerate(candidates) if one.candidate == candidate]
        judged = _best_alone(search, numbers, thresholds)
        if judged is None:
            yield OwnTerm(candidate, "its parameters would have the wrong sign")
            continue
        said = short.get(candidate) or objection(judged, thresholds)
        said = said or "by itself it passes; what is named explains the same, or more"
        yield OwnTerm(candidate, said, nearest(fit, search, [judged], said))


def _best_alone(search: Search, numbers: Sequence[int], thresholds: Thresholds) -> Judged | None:
    """The candidate of these that explains most by itself; None if each has a wrong sign."""
    alone = [solve(search.projection, (number,)) or NOTHING for number in numbers]
    best = max(alone, key=lambda one: one.gain, default=NOTHING)
    return all_judged(search, best, thresholds)[0] if best.numbers else None


def _reach(fit: Fitted, search: Search, decision: Decision, thresholds: Thresholds) -> Reach:
    """What the recordings of a fit can show."""
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
    said = [f"{one.shaped.candidate.label} comes nearest, but {decision.objection}" for one in more]
    return answer._replace(reason="; ".join([answer.reason, *said]))


def _nearest(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    answer: Answer,
    thresholds: Thresholds,
) -> Nearest | None:
    """Of effects that do not do, those that came furthest; on the joint that errs most."""
    worst, names = _worst(proof), search.evidence.joints
    short = tuple(one.effect for one in proof.short)
    effects = short or proof.trial.zero or decision.nearest
    said = answer.objection or decision.objection
    if not any(worst in one.shaped.joints(names) for one in effects):
        candidates = search.projection.candidates
        there = [i for i, one in enumerate(candidates) if worst in one.joints(names)]
        if judged := _best_alone(search, there, thresholds):
            effects, said = (judged,), objection(judged, thresholds) or said
    return nearest(fit, search, effects, said) if effects else None


def with_left(answer: Answer, left: Sequence[UnknownForce]) -> Answer:
    """The answer, and what its effects leave on joints where none of them acts, largest first."""
    if not left:
        return answer
    said = [
        f"where none of the effects acts, {one.strength:.2%} of the drive force of {one.joint} are "
        f"left, most like {one.signatures[0].said}"
        for one in left
    ]
    return answer._replace(reason="; ".join([answer.reason, *said]), unknown=left[0])


def with_flow(answer: Answer, flows: Sequence[Flow]) -> Answer:
    """The answer where the flow of oil, which the torque cannot show, tells something more."""
    strange = [
        f"{flow.unexplained:.1%} of the flow of {flow.joint} follow a law, but none of the "
        "catalogue" + (": most of it is what air in the oil takes" if flow.airy else "")
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


def with_pulsation(answer: Answer, pulsations: Sequence[Pulsation]) -> Answer:
    """The answer where a line is in the force that no motion makes."""
    return _unknown_beside(
        answer,
        [
            f"the force of {one.joint} pulsates at {one.frequency:.2f} Hz in all recordings "
            f"({one.strength:.1%} of it), which no effect of the catalogue does"
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
    more = answer.verdict in (Verdict.NAMED, Verdict.CLASS)
    verdict = Verdict.AND_MORE if more else answer.verdict
    return answer._replace(verdict=verdict, reason=f"{answer.reason}; {text}")


def _named_beside(answer: Answer, said: Sequence[str]) -> Answer:
    """The answer, and effects that are named for another reason."""
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
