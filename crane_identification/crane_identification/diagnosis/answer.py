"""The answer of a diagnosis: what the force says, then loads, oil and pulsation beside it."""

from crane_identification.diagnosis.decision import Decision
from crane_identification.diagnosis.fit import Fitted
from crane_identification.diagnosis.hydraulics import Flows
from crane_identification.diagnosis.nearest import Nearest, nearest
from crane_identification.diagnosis.proof import Proof
from crane_identification.diagnosis.pulsation import pulsations
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.strength import detectable
from crane_identification.diagnosis.thresholds import Thresholds
from crane_identification.diagnosis.verdict import (
    Answer,
    Reach,
    Verdict,
    judge,
    with_flow,
    with_loads,
    with_pulsation,
)


def answered(
    fit: Fitted,
    search: Search,
    decision: Decision,
    proof: Proof,
    flow: Flows,
    thresholds: Thresholds,
) -> Answer:
    """What these results come to."""
    least = detectable(search, decision.threshold)
    answer = judge(proof, Reach(search.testable_share, least, fit.undetermined), thresholds)
    if answer.verdict is Verdict.UNKNOWN:
        answer = answer._replace(nearest=_nearest(fit, search, decision, proof, answer))
    answer = with_flow(with_loads(answer, proof.gap.loads), flow.found)
    return with_pulsation(answer, pulsations(proof.lines, thresholds))


def _nearest(
    fit: Fitted, search: Search, decision: Decision, proof: Proof, answer: Answer
) -> Nearest | None:
    """Of effects that do not do, those that came furthest."""
    short = tuple(one.effect for one in proof.short)
    effects = short or proof.trial.zero or decision.nearest
    objection = answer.objection or decision.objection
    return nearest(fit, search, effects, objection) if effects else None
