"""The diagnosis: from logs and a model to a verdict, findings, an extended model, and its proof."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from crane_identification.data.log import Log
from crane_identification.diagnosis import findings as schema
from crane_identification.diagnosis.answer import Answer, answered
from crane_identification.diagnosis.candidates import (
    NO_LOAD,
    WHOLE,
    Candidate,
    Weighed,
    wanted,
)
from crane_identification.diagnosis.constants import (
    FORM_ERROR,
    PARTLY_SEEN_SHARE,
    PLAUSIBLE_SHARE,
    SURE_SIGMAS,
)
from crane_identification.diagnosis.decision import Decision, decide
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.findings import Findings, Verdict
from crane_identification.diagnosis.fit import Fitted, fitted
from crane_identification.diagnosis.flow import Flow, Flows, Quantity, Usual, examine, load_usual
from crane_identification.diagnosis.gap import OF_PERIODS, OF_SAMPLES, Commanded, Gap, commanded
from crane_identification.diagnosis.judgement import Judged, found_values, in_place_of
from crane_identification.diagnosis.lookalikes import SENSING
from crane_identification.diagnosis.projection import Subset, extended
from crane_identification.diagnosis.proof import Finding, Proof, Value, found_effect, proved
from crane_identification.diagnosis.residuals import curves_of, energy_shares, regions
from crane_identification.diagnosis.search import Search, search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.estimation.autoregression import Autoregression
from crane_identification.options import Options
from crane_identification.thresholds import Thresholds
from crane_identification.validation.force_validation import elsewhere
from crane_identification.validation.motion_validation import MotionValidation
from crane_model.errors import ConfigurationError, DataError
from crane_model.flow import FLOW_EFFECTS
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.result_file import OpenMember, OpenQuestion, OpenQuestions, QuestionKind
from crane_model.terms import REGISTRY
from crane_model.terms.force_scale import USUAL_SCALE_ERROR

LAST = -1  # place of the effect that was put into a set: it is smaller where signs forbid the rest
NOISE_LAGS = 64  # rows after which noise is forgotten
NEAREST_MEMBERS = 4  # effects that come closest, of an answer that the catalogue does not hold it


@dataclass(frozen=True)
class Diagnosis:
    """The results of a diagnosis `without` some effects, step by step, and the answer."""

    fit: Fitted
    search: Search
    decision: Decision
    flow: Flows
    proof: Proof
    commanded: Commanded
    answer: Answer
    without: frozenset[str]

    @property
    def verdict(self) -> Verdict:
        return self.answer.verdict

    @property
    def reason(self) -> str:
        return self.answer.reason

    @property
    def joints(self) -> tuple[str, ...]:
        return self.before.joints

    @property
    def before(self) -> Model:
        return self.fit.before

    @property
    def after(self) -> Model:
        """The model with the findings."""
        return self.proof.trial.model

    @property
    def gap(self) -> Gap:
        return self.proof.gap

    @property
    def training(self) -> Evidence:
        return self.fit.evidence

    @property
    def held_out(self) -> Evidence:
        return self.fit.held_out

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Missing effects, strongest first; deviations include errors of the form."""
        found, trial = [], self.proof.trial
        for one, values in zip(trial.effects, trial.values, strict=True):
            form = 0.0 if one.shaped.candidate.drawn else self._form_error(one)
            scale = 0.0 if one.shaped.term.family == SENSING else USUAL_SCALE_ERROR
            parameters = []
            for k, value in enumerate(values):
                share = np.hypot(form, scale if k < len(one.shaped.positive) else 0.0)
                error = float(np.hypot(value.std_dev, share * value.change[0]))
                parameters.append(replace(value, std_dev=error))
            found.append(Finding(one, tuple(parameters)))
        return tuple(found)

    def _form_error(self, one: Judged) -> float:
        """Relative error of the parameters of an effect because of its form."""
        gap, joints = self.gap, one.shaped.joints(self.joints)
        noise = np.where(np.isfinite(gap.floor), gap.floor, gap.sample_noise)
        error = np.fmax(gap.after, gap.training_after)
        beyond = np.sqrt(np.maximum(error**2 - noise**2, 0.0))[joints].mean()
        return float(FORM_ERROR * beyond / max(one.strength, np.finfo(float).tiny))

    @property
    def warnings(self) -> tuple[str, ...]:
        gap = self.gap
        further = elsewhere(self.joints, gap.after, gap.training_after, gap.floor)
        return (*self.fit.warnings, *further)

    def results(self, suspicions: Sequence[str] = ()) -> Findings:
        """The content of findings.json."""
        return Findings(
            verdict=self.verdict,
            reason=self.reason,
            values_kept=self.fit.fixed,
            where=_where(self),
            findings=[_finding(self, one) for one in self.findings]
            + [_of_flow(self, one.joint, each) for one in self.flow.found for each in one.missing]
            + [_of_load(self, one) for one in self.gap.loads if one.found],
            nearest=self.answer.nearest,
            own_terms=list(self.answer.own),
            unknown=self.answer.unknown,
            model_error=_errors(self),
            left=_left(self),
            undetermined=list(self.fit.undetermined),
            clock=self.fit.session.fallback,
            needs_units=list(self.fit.uncalibrated),
            warnings=list(self.warnings),
            without=sorted(self.without),
            not_testable=_untried(self.search.untestable),
            partly_seen=_partly_seen(self.search),
            not_observable=[
                *_untried(self.search.unobservable),
                *(
                    schema.Untried(
                        effect=effect,
                        name=FLOW_EFFECTS[effect].effect.name,
                        joint=joint,
                        reason=reason,
                    )
                    for (effect, joint), reason in self.flow.unobservable.items()
                ),
            ],
            pulsations=[
                schema.FoundPulsation.model_validate(one, from_attributes=True)
                for one in self.proof.pulsations
            ],
            flow={one.joint: _balance(one) for one in self.flow.found},
            open=_open_questions(self),
            named_from=dict(self.answer.named_from),
            suspicions=list(suspicions),
        )


def diagnose(
    model: Model,
    training: Sequence[Log],
    validation: Sequence[Log],
    options: Options,
    thresholds: Thresholds,
    progress: Progress = silent,
    usual: Usual | None = None,
    without: Collection[str] = (),
    fixed: bool = False,
    own: Collection[str] = (),
    fit: Fitted | None = None,
) -> Diagnosis:
    """Find where `model` disagrees with the recordings, and why.

    `usual` says what is usual of the hydraulics (None: the packaged values). `without` names
    effects (types of terms) that the answer is sought without: what else could it be? Effects of
    the types `own` are reported, named or not.

    The model is fitted to the training recordings first, so that its values are not what differs.
    With `fixed` they are kept instead, and what differs from them is what has changed. `fit` is
    what `fitted` gives for these recordings, if that is known already.

    `DataError` if recordings cannot be used or do not determine the parameters of the model;
    `ConfigurationError` if an effect is not in the catalogue, or values to keep are missing.
    """
    for name, logs in (("--train", training), ("--validate", validation)):
        if not logs:
            raise DataError(f"no recordings given; name at least one with {name}")
    check_known(without)
    fit = fit or fitted(model, training, validation, options, fixed, progress)
    found = search(fit.evidence, wanted(fit, without), thresholds, progress)
    selection = ForwardSelection(found, progress)
    decision = decide(selection)
    found = selection.search  # all of it: the decision is taken
    proof = proved(fit, found, decision.passed, progress)
    effects = [one.shaped.candidate for one in proof.trial.effects]
    flow = examine(fit.evidence, fit.held_out, usual or load_usual(), thresholds, effects)
    answer = answered(fit, found, decision, proof, flow, own)
    after = proof.gap.carried if proof.trial.effects else fit.before
    moved = commanded(fit, after, validation)
    return Diagnosis(fit, found, decision, flow, proof, moved, answer, frozenset(without))


def check_known(effects: Collection[str]) -> None:
    """`ConfigurationError` with all that there are if one of `effects` is not in the catalogue."""
    known = sorted(name for name, cls in REGISTRY.items() if cls.effect)
    if unknown := sorted(set(effects) - set(known)):
        raise ConfigurationError(
            f"{', '.join(unknown)}: no effect that shows in the force; there are {', '.join(known)}"
        )


# The parts of the results.


def _where(diagnosis: Diagnosis) -> dict[str, schema.FoundPlace]:
    first = diagnosis.proof.before
    shares = energy_shares(diagnosis.training, first, diagnosis.gap)
    places = regions(diagnosis.fit, first)
    return {
        joint: schema.FoundPlace(energy_share=share, region=place)
        for joint, share, place in zip(diagnosis.joints, shares, places, strict=True)
    }


def _errors(diagnosis: Diagnosis) -> schema.ModelErrors:
    gap = diagnosis.gap

    def by_joint(values: np.ndarray) -> dict[str, float]:
        return dict(zip(diagnosis.joints, values, strict=True))

    def side(error: np.ndarray, motion: MotionValidation) -> dict[str, schema.ModelError]:
        return {
            joint: schema.ModelError(
                force_relative_error=error[j],
                noise_floor=gap.floor[j],
                best_achievable=gap.best[j],
                motion_error=motion.position_rms[j],
            )
            for j, joint in enumerate(gap.joints)
        }

    return schema.ModelErrors(
        before=side(gap.before, gap.motion_before),
        after=side(gap.after, gap.motion_after),
        closed=by_joint(gap.held_to.closed),
        loads=[
            schema.CarriedLoad(recording=one.recording, value=one.mass, std_dev=one.std_dev)
            for one in gap.loads
        ],
        from_commands=[
            schema.CommandedError(
                horizon=before.horizon,
                windows=before.windows,
                displacement=by_joint(before.path),
                before=by_joint(before.position_rms),
                after=by_joint(after.position_rms),
            )
            for before, after in diagnosis.commanded.pairs
        ],
        from_commands_reason=diagnosis.commanded.reason,
    )


def _left(diagnosis: Diagnosis) -> dict[str, schema.LeftResidual]:
    fit, trial, gap = diagnosis.fit, diagnosis.proof.trial, diagnosis.gap
    errors, gates = np.maximum(gap.after, gap.training_after), trial.thresholds.gates
    beyond_noise = gap.beyond(errors, gates, OF_PERIODS)
    if trial.formless:  # model forms always leave more than the noise of sensors
        beyond_noise |= gap.beyond(errors, gates, OF_SAMPLES)
    places = regions(fit, trial)
    return {
        joint: schema.LeftResidual(
            learnable_share=trial.learnt.share[j],
            systematic=bool(trial.law[j]),
            beyond_noise=bool(beyond_noise[j]),
            region=places[j],
        )
        for j, joint in enumerate(diagnosis.joints)
    }


def _finding(diagnosis: Diagnosis, finding: Finding) -> schema.FindingEntry:
    judged, candidate, training = finding.judged, finding.candidate, diagnosis.training
    magnitude = training.acting(judged.shaped.columns, finding.added)
    return schema.FindingEntry(
        **found_effect(candidate),
        changed=candidate.changes,
        ambiguity_group=[schema.FoundEffect(**found_effect(one)) for one in judged.indistinct],
        parameters=[_parameter(value) for value in finding.parameters],
        curves=curves_of(
            training,
            judged.shaped.term,
            (one.value for one in finding.linear),
            (one.std_dev for one in finding.linear),
        ),
        deviation=[
            curve
            for one in diagnosis.answer.forms
            if one.candidate == candidate
            for curve in one.curves
        ],
        carried_in=finding.carried_in(training.sources),
        score=judged.score,
        threshold=judged.threshold,
        runner_up=judged.runner_up and schema.FoundEffect(**found_effect(judged.runner_up)),
        margin=judged.margin,
        margin_needed=judged.needed,
        relative_magnitude=magnitude,
        visible_magnitude=min(judged.strength, magnitude),
        discriminated_by=candidate.effect.discriminated_by,
    )


def _of_load(diagnosis: Diagnosis, one: Weighed) -> schema.FindingEntry:
    cls = next(type(term) for term in diagnosis.gap.carried.terms if term.carries_loads)
    mass = _parameter(Value("m_payload", one.mass, one.std_dev, "kg"))
    carried = {mass.name: [one.recording], NO_LOAD: sorted(diagnosis.training.sources)}
    score = (one.mass / one.std_dev) ** 2
    what = Candidate(cls, None)
    return _by_itself(what, WHOLE, mass, score, SURE_SIGMAS**2, carried_in=carried)


def _of_flow(diagnosis: Diagnosis, joint: str, one: Quantity) -> schema.FindingEntry:
    sigmas = diagnosis.search.thresholds.method.flow_sigmas
    threshold = (sigmas * one.std_dev / one.value) ** 2 * one.score
    value = _of_quantity(one)
    return _by_itself(one, joint, value, one.score, threshold, visible_magnitude=one.share)


def _by_itself(
    what: Candidate | Quantity,
    joint: str,
    value: schema.FoundParameter,
    score: float,
    threshold: float,
    **known: Any,
) -> schema.FindingEntry:
    """A finding with one parameter, which competed with no other effect."""
    return schema.FindingEntry(
        effect=what.type,
        name=what.effect.name,
        joint=joint,
        parameters=[value],
        score=score,
        threshold=threshold,
        margin=score,
        discriminated_by=what.effect.discriminated_by,
        **known,
    )


def _balance(flow: Flow) -> schema.FlowBalance:
    return schema.FlowBalance(
        unexplained_share=flow.unexplained,
        known_time=flow.known,
        recorded_time=flow.recorded,
        quantities={
            one.type: schema.HydraulicQuantity(
                **dict(_of_quantity(one)), usual_limit=one.usual, identified=one.own
            )
            for one in flow.quantities
        },
    )


def _of_quantity(one: Quantity) -> schema.FoundParameter:
    return schema.FoundParameter(
        name=one.type,
        value=one.value,
        std_dev=one.std_dev,
        unit=one.unit,
        minimum=None,
        determined=bool(one.determined),
    )


def _parameter(one: Value) -> schema.FoundParameter:
    """A parameter, whether the recordings determine it, and what it has changed from."""
    given = one.name, one.value, one.std_dev, one.unit, one.minimum
    parameter = schema.FoundParameter.of(*given)
    if one.before is None:
        return parameter
    (before, before_std_dev), (change, change_std_dev) = one.before, one.change
    return schema.ChangedParameter(
        **dict(parameter),
        before=before,
        before_std_dev=before_std_dev,
        change=change,
        change_std_dev=change_std_dev,
    )


def _partly_seen(search: Search) -> list[schema.PartlySeen]:
    """Friction of which the used rows see little, at some value of its nonlinear parameters."""
    return [
        schema.PartlySeen(**found_effect(candidate), seen_share=share)
        for candidate, share in search.seen.items()
        if share < PARTLY_SEEN_SHARE
    ]


def _untried(candidates: Mapping[Candidate, str]) -> list[schema.Untried]:
    return [schema.Untried(**found_effect(one), reason=why) for one, why in candidates.items()]


# What is open, as `design --discriminate` reads it: members with their sizes.


def _open_questions(diagnosis: Diagnosis) -> OpenQuestions:
    fit, search = diagnosis.fit, diagnosis.search
    step = fit.training.recordings[0].step
    pairs = zip(diagnosis.joints, search.whitener.noise, strict=False)  # the first zone
    return OpenQuestions(
        row_rate=1.0 / (fit.training.factor * step),
        noise={joint: _as_white(one) for joint, one in pairs},
        questions=[
            *_ambiguous(diagnosis),
            *_nearest_question(diagnosis),
            *_undetermined(diagnosis),
        ],
    )


def _as_white(noise: Autoregression | None) -> float | None:
    """Standard deviation of white noise as strong as this one is at low frequencies."""
    if noise is None:
        return None
    covariance = noise.autocovariance(NOISE_LAGS)
    return float(np.sqrt(max(covariance[0] + 2.0 * covariance[1:].sum(), 0.0)))


def _ambiguous(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    search, effects = diagnosis.search, diagnosis.proof.trial.effects
    subset = search.together(one.shaped for one in effects)
    for place, judged in enumerate(effects if subset.numbers else ()):
        if not judged.indistinct or judged.shaped.candidate.changes:
            continue
        others = {
            search.projection.candidates[one.numbers[-1]].candidate: one
            for one in in_place_of(search, subset, place)
        }
        known = [others[one] for one in judged.indistinct if one in others]
        members = [_member(search, subset, place, None)]
        members += [_member(search, one, LAST, subset.gain) for one in known]
        yield _question(diagnosis, QuestionKind.AMBIGUOUS, members, judged.threshold)


def _nearest_question(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    """Ask which of the nearest effects of the joint it is, if none of the catalogue is named."""
    if diagnosis.verdict is not Verdict.UNKNOWN or diagnosis.answer.nearest is None:
        return
    search, near = diagnosis.search, diagnosis.answer.nearest.effects[0]
    candidates = search.projection.candidates
    alone = sorted(extended(search.projection, search.sets[0][0]), key=lambda one: -one.gain)
    on_joint = [one for one in alone if candidates[one.numbers[-1]].candidate.where == near.joint]
    first = on_joint[:NEAREST_MEMBERS]
    if len(first) > 1:
        members = [
            _member(search, one, 0, first[0].gain if place else None)
            for place, one in enumerate(first)
        ]
        yield _question(diagnosis, QuestionKind.NEAREST, members, near.threshold or 0.0)


def _undetermined(diagnosis: Diagnosis) -> Iterator[OpenQuestion]:
    """Each term of the model that was left out, at a size that would matter."""
    evidence, setting = diagnosis.training, diagnosis.before.setting
    for term in diagnosis.fit.left_out:
        sizes = np.nan_to_num(evidence.rms(evidence.columns(term).sum(axis=2)))
        c = int(np.argmax(sizes))
        size = PLAUSIBLE_SHARE * evidence.force_rms[c] / sizes[c] if sizes[c] > 0.0 else 1.0
        member = OpenMember(
            effect=term.type,
            name=term.type if term.effect is None else term.effect.name,
            joint=term.only_joint or WHOLE,
            term=term.model_dump(mode="json"),
            values=[float(size)] * len(term.parameters(setting)),
            separation=None,
            discriminated_by="" if term.effect is None else term.effect.discriminated_by,
        )
        yield OpenQuestion(
            kind=QuestionKind.UNDETERMINED,
            members=[member],
            needed=float(np.sqrt(diagnosis.decision.threshold)),
            needed_share=0.0,
        )


def _question(
    diagnosis: Diagnosis, kind: QuestionKind, members: Sequence[OpenMember], threshold: float
) -> OpenQuestion:
    alike = diagnosis.search.thresholds.method.alike_correlation
    return OpenQuestion(
        kind=kind,
        members=list(members),
        needed=float(np.sqrt(max(threshold, diagnosis.decision.threshold))),
        needed_share=float(np.sqrt(1.0 - alike**2)),
    )


def _member(search: Search, subset: Subset, place: int, best: float | None) -> OpenMember:
    """The effect at one place of a set, with its values there."""
    shaped = search.projection.candidates[subset.numbers[place]]
    return OpenMember(
        **found_effect(shaped.candidate),
        term=shaped.term.model_dump(mode="json"),
        values=found_values(search, subset, place).tolist(),
        separation=None if best is None else float(np.sqrt(max(best - subset.gain, 0.0))),
        discriminated_by=shaped.candidate.effect.discriminated_by,
    )
