"""What a diagnosis leaves open, as `design --settle` reads it: members with their sizes."""

from collections.abc import Iterator, Sequence

import numpy as np

from crane_identification.diagnosis.answer.verdict import Verdict
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.decision.likeness import in_place_of
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import Subset, extended, solve
from crane_identification.estimation.autoregression import Autoregression
from crane_model.open_question import OpenMember, OpenQuestion, OpenQuestions, QuestionKind
from crane_model.terms import Term

LAST = -1  # place of the effect that was put into a set: it is smaller where signs forbid the rest
LAGS = 64  # rows after which noise is forgotten
NEAREST = 4  # effects that come closest, of an answer that none of the catalogue is it
PLAUSIBLE_SHARE = 0.02  # rms of a term that is not determined, over that of the force of its joint


def open_questions(diagnosis: Diagnosis) -> OpenQuestions:
    """All that another experiment could settle."""
    fit, search = diagnosis.fit, diagnosis.search
    step = fit.training.recordings[0].step
    pairs = zip(diagnosis.joints, search.whitener.noise, strict=False)  # the first zone
    return OpenQuestions(
        row_rate=1.0 / (fit.training.factor * step),
        noise={joint: _as_white(one) for joint, one in pairs},
        questions=[*_classes(diagnosis), *_nearest(diagnosis), *_undetermined(diagnosis)],
    )


def _as_white(noise: Autoregression | None) -> float | None:
    """Standard deviation of white noise as strong as this one is at low frequencies."""
    if noise is None:
        return None
    covariance = noise.autocovariance(LAGS)
    return float(np.sqrt(max(covariance[0] + 2.0 * covariance[1:].sum(), 0.0)))


def _classes(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    search, effects = diagnosis.search, diagnosis.proof.trial.effects
    if not any(one.indistinct for one in effects):
        return
    subset = solve(search.projection, tuple(search.number(one.shaped) for one in effects))
    for place, judged in enumerate(effects):
        if not judged.indistinct or subset is None or judged.shaped.candidate.changes:
            continue
        others = {
            search.projection.candidates[one.numbers[-1]].candidate: one
            for one in in_place_of(search, subset, place)
        }
        known = [others[one] for one in judged.indistinct if one in others]
        yield _question(
            diagnosis,
            QuestionKind.CLASS,
            [_member(search, subset, place, None)]
            + [_member(search, one, LAST, subset.gain) for one in known],
            judged,
        )


def _nearest(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    """Where nothing of the catalogue is it: what comes closest by itself, on the joint of that."""
    if diagnosis.verdict is not Verdict.UNKNOWN or diagnosis.answer.nearest is None:
        return
    search, near = diagnosis.search, diagnosis.answer.nearest
    joint = near.effects[0].shaped.candidate.joint
    alone = sorted(extended(search.projection, search.sets[0][0]), key=lambda one: -one.gain)
    first = [one for one in alone if _candidate(search, one).joint == joint][:NEAREST]
    if len(first) > 1:
        members = [
            _member(search, one, 0, first[0].gain if place else None)
            for place, one in enumerate(first)
        ]
        yield _question(diagnosis, QuestionKind.NEAREST, members, near.effects[0])


def _undetermined(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    """Each term of the model that was left out, at a size that would matter."""
    evidence, setting = diagnosis.training, diagnosis.before.setting
    for term in diagnosis.fit.left_out:
        sizes = np.nan_to_num(evidence.rms(evidence.columns(term).sum(axis=2)))
        c = int(np.argmax(sizes))
        size = PLAUSIBLE_SHARE * evidence.force_rms[c] / sizes[c] if sizes[c] > 0.0 else 1.0
        values = [float(size)] * len(term.parameters(setting))
        settled = "" if term.effect is None else term.effect.settled_by
        name = term.type if term.effect is None else term.effect.name
        member = OpenMember(
            effect=term.type,
            name=name,
            joint=term.only_joint or "all",
            term=term.model_dump(mode="json"),
            values=values,
            separation=None,
            settled_by=settled,
        )
        yield OpenQuestion(
            kind=QuestionKind.UNDETERMINED,
            members=[member],
            needed=float(np.sqrt(diagnosis.decision.threshold)),
            needed_share=0.0,
        )


def _question(
    diagnosis: Diagnosis, kind: QuestionKind, members: Sequence[OpenMember], judged: Judged
) -> OpenQuestion:
    alike = diagnosis.thresholds.method.alike_correlation
    return OpenQuestion(
        kind=kind,
        members=list(members),
        needed=float(np.sqrt(max(judged.threshold, diagnosis.decision.threshold))),
        needed_share=float(np.sqrt(1.0 - alike**2)),
    )


def _candidate(search: Search, subset: Subset) -> Candidate:
    return search.projection.candidates[subset.numbers[-1]].candidate


def _member(search: Search, subset: Subset, place: int, best: float | None) -> OpenMember:
    """The effect at one place of a set, with its values there."""
    projection = search.projection
    shaped: ShapedCandidate = projection.candidates[subset.numbers[place]]
    columns = np.concatenate([projection.columns_of[i] for i in subset.numbers])
    own = projection.owner[columns] == subset.numbers[place]
    scale = projection.scale[columns[own]]
    values = np.divide(subset.values[own], scale, out=np.zeros(own.sum()), where=scale > 0.0)
    term: Term = shaped.term
    candidate = shaped.candidate
    return OpenMember(
        effect=candidate.type,
        name=candidate.effect.name,
        joint=candidate.where,
        term=term.model_dump(mode="json"),
        values=values.tolist(),
        separation=None if best is None else float(np.sqrt(max(best - subset.gain, 0.0))),
        settled_by=candidate.effect.settled_by,
    )
