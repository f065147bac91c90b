"""The answer of a diagnosis: what the force says, then loads, oil and pulsation beside it."""

from collections.abc import Sequence

from crane_identification.diagnosis.answer.unknown import (
    UnknownForce,
    left_elsewhere,
    unknown_force,
)
from crane_identification.diagnosis.answer.verdict import Answer, Reach, Verdict, judge
from crane_identification.diagnosis.decision.decision import Decision
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.flow.hydraulics import Flow, Flows
from crane_identification.diagnosis.proof.proof import Nearest, Proof, nearest
from crane_identification.diagnosis.proof.pulsation import Pulsation
from crane_identification.diagnosis.search.energy import (
    detectable,
    named_from,
    testable_share,
)
from crane_identification.diagnosis.search.loads import Weighed
from crane_identification.diagnosis.search.search import Search
from crane_identification.thresholds import Thresholds


def answered(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    flow: Flows,
    thresholds: Thresholds,
) -> Answer:
    """What these results come to."""
    reach = _reach(fit, search, decision, thresholds)
    answer = judge(proof, reach, thresholds)
    if answer.verdict is not Verdict.INSUFFICIENT:  # what is left then is of the model, too
        answer = _unknown_beside(answer, decision.beyond)
    if answer.verdict is Verdict.NONE:
        answer = with_too_little(answer, decision)
    if answer.verdict is Verdict.UNKNOWN:
        answer = answer._replace(
            nearest=_nearest(fit, search, decision, proof, answer), unknown=unknown_force(search)
        )
    elif answer.verdict is Verdict.AND_MORE:
        effects = proof.trial.effects
        left = left_elsewhere(search, effects, decision.threshold, thresholds)
        answer = with_left(answer, left)
    answer = with_flow(with_loads(answer, proof.gap.loads), flow.found)
    answer = with_pulsation(answer, proof.pulsations)
    return answer._replace(named_from=reach.named)


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
    fit: Fitted, search: Search, decision: Decision, proof: Proof, answer: Answer
) -> Nearest | None:
    """Of effects that do not do, those that came furthest."""
    short = tuple(one.effect for one in proof.short)
    effects = short or proof.trial.zero or decision.nearest
    objection = answer.objection or decision.objection
    return nearest(fit, search, effects, objection) if effects else None


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
