"""findings.json: the answer for programs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crane_identification.diagnosis.answer.unknown import Drawing
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.findings_file import (
    CarriedLoad,
    ChangedParameter,
    CommandedGap,
    DrawnShape,
    FindingEntry,
    Findings,
    FoundEffect,
    FoundParameter,
    FoundPlace,
    FoundPulsation,
    FoundRegion,
    GapOfModels,
    GapSide,
    LeftResidual,
    NearEffect,
    NearestEffects,
    NearestGap,
    OwnTermEntry,
    SessionClock,
    Untried,
    drawn_shape,
    unknown_place,
)
from crane_identification.diagnosis.flow_and_load_findings import balance, of_flow, of_load
from crane_identification.diagnosis.open_questions import open_questions
from crane_identification.diagnosis.proof.extension import Finding, Value, carried_in
from crane_identification.diagnosis.proof.gap import Gap
from crane_identification.diagnosis.proof.proof import Nearest
from crane_identification.diagnosis.region import (
    Region,
    correlation_left,
    energy_shares,
    regions,
)
from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.diagnosis.search.energy import acting
from crane_identification.diagnosis.variables import feature_unit
from crane_identification.notation import is_determined
from crane_identification.validation.motion_validation import MotionValidation

WHITE = 0.25  # correlation of neighbouring rows up to which what is left counts as white


def write(path: Path | str, diagnosis: Diagnosis, suspicions: Sequence[str] = ()) -> None:
    """Write the file, with what is suspicious of the recordings."""
    answer(diagnosis, suspicions).write(path)


def content(diagnosis: Diagnosis, suspicions: Sequence[str] = ()) -> dict[str, Any]:
    """What the file holds, as it is read from it."""
    return answer(diagnosis, suspicions).plain()


def answer(diagnosis: Diagnosis, suspicions: Sequence[str] = ()) -> Findings:
    """All that a diagnosis found."""
    fit, gap, flow = diagnosis.fit, diagnosis.gap, diagnosis.flow
    return Findings(
        verdict=diagnosis.verdict,
        reason=diagnosis.reason,
        values_kept=fit.fixed,
        where=_where(diagnosis),
        findings=[_finding(diagnosis, one) for one in diagnosis.findings]
        + [of_flow(diagnosis, one.joint, each) for one in flow.found for each in one.missing]
        + [of_load(diagnosis, one) for one in gap.loads if one.found],
        nearest=_near(diagnosis.answer.nearest),
        own_terms=[
            OwnTermEntry(
                **dict(_effect(one.candidate)), objection=one.objection, tried=_near(one.near)
            )
            for one in diagnosis.answer.own
        ],
        unknown=unknown_place(diagnosis),
        gap=GapOfModels(
            before=_side(gap, gap.before, gap.motion_before),
            after=_side(gap, gap.after, gap.motion_after),
            closed=dict(zip(diagnosis.joints, gap.held_to.closed, strict=True)),
            loads=[
                CarriedLoad(recording=one.recording, value=one.mass, std_dev=one.std_dev)
                for one in gap.loads
            ],
            from_commands=_from_commands(diagnosis),
            from_commands_reason=diagnosis.commanded.reason,
        ),
        left=_left(diagnosis),
        undetermined=list(fit.undetermined),
        clock=SessionClock(
            through_session=fit.session.fallback is None, reason=fit.session.fallback
        ),
        needs_units=list(fit.uncalibrated),
        warnings=list(diagnosis.warnings),
        without=sorted(diagnosis.without),
        not_testable=_untried(diagnosis.search.untestable),
        not_observable=_untried(diagnosis.search.unobservable)
        + [
            Untried(effect=effect, joint=joint, reason=reason)
            for (effect, joint), reason in flow.unobservable.items()
        ],
        pulsations=[
            FoundPulsation(joint=one.joint, frequency=one.frequency, strength=one.strength)
            for one in diagnosis.proof.pulsations
        ],
        flow={one.joint: balance(one) for one in flow.found},
        open=open_questions(diagnosis),
        named_from=dict(diagnosis.answer.named_from),
        suspicions=list(suspicions),
    )


def _where(diagnosis: Diagnosis) -> dict[str, FoundPlace]:
    motion, first = diagnosis.gap.motion_before, diagnosis.proof.before
    shares, places = energy_shares(diagnosis.training, first), regions(diagnosis.fit, first)
    return {
        joint: FoundPlace(
            energy_share=shares[j],
            motion_error=motion.position_rms[j],
            region=_region(diagnosis, places[j]),
        )
        for j, joint in enumerate(diagnosis.joints)
    }


def _from_commands(diagnosis: Diagnosis) -> list[CommandedGap]:
    def by_joint(values: np.ndarray) -> dict[str, float]:
        return dict(zip(diagnosis.joints, values, strict=True))

    return [
        CommandedGap(
            horizon=before.horizon,
            windows=before.windows,
            way=by_joint(before.way),
            before=by_joint(before.position_rms),
            after=by_joint(after.position_rms),
        )
        for before, after in diagnosis.commanded.pairs
    ]


def _left(diagnosis: Diagnosis) -> dict[str, LeftResidual]:
    fit, trial, gap = diagnosis.fit, diagnosis.proof.trial, diagnosis.gap
    errors, gates = np.maximum(gap.after, gap.training_after), diagnosis.thresholds.gates
    beyond_noise = gap.beyond_noise(errors, gates)
    if trial.formless:  # laws always leave more than the noise of sensors
        beyond_noise |= gap.beyond_samples(errors, gates)
    return {
        joint: LeftResidual(
            white=bool(abs(correlation) < WHITE),
            correlation=correlation,
            learnable_share=share,
            law=bool(law),
            beyond_noise=bool(beyond),
            region=_region(diagnosis, region),
        )
        for joint, correlation, share, law, beyond, region in zip(
            diagnosis.joints,
            correlation_left(fit.evidence, trial),
            trial.learnt.share,
            trial.law,
            beyond_noise,
            regions(fit, trial),
            strict=True,
        )
    }


def _region(diagnosis: Diagnosis, region: Region | None) -> FoundRegion | None:
    if region is None:
        return None
    setting, counts = diagnosis.before.setting, bool(diagnosis.fit.uncalibrated)
    return FoundRegion(
        variable=region.variable,
        range=(region.low, region.high),
        unit=feature_unit(region.variable, setting, counts),
        share=region.share,
    )


def _finding(diagnosis: Diagnosis, finding: Finding) -> FindingEntry:
    judged, candidate = finding.judged, finding.candidate
    return FindingEntry(
        effect=candidate.type,
        name=candidate.effect.name,
        joint=candidate.where,
        changed=candidate.changes,
        class_members=[_effect(one) for one in judged.indistinct],
        parameters=[_parameter(value) for value in finding.parameters],
        shapes=_shapes(diagnosis, finding),
        carried_in=carried_in(finding, diagnosis.training.sources),
        score=judged.score,
        threshold=judged.threshold,
        false_alarm_rate=diagnosis.thresholds.method.false_alarm_rate,
        runner_up=None if judged.runner_up is None else _effect(judged.runner_up),
        margin=judged.margin,
        margin_needed=judged.needed,
        visibility=judged.visibility,
        strength=acting(diagnosis.training, judged.shaped.columns, finding.added),
        visible_strength=judged.strength,
        held_out_gains=dict(zip(judged.fold_names, judged.held_out, strict=True)),
        settled_by=candidate.effect.settled_by,
    )


def _shapes(diagnosis: Diagnosis, finding: Finding) -> list[DrawnShape]:
    """The law of a finding as it was drawn, for each factor; none where it is a formula."""
    shaped = finding.judged.shaped
    own = finding.parameters[: len(shaped.positive)]
    values, std_devs = (
        shaped.term.curves(np.array([getattr(one, name) for one in own]))
        for name in ("value", "std_dev")
    )
    return [
        drawn_shape(diagnosis, finding.candidate.where, Drawing(*pair, own[k].unit))
        for k, pair in enumerate(zip(values, std_devs, strict=True))
    ]


def _effect(one: Candidate) -> FoundEffect:
    return FoundEffect(effect=one.type, name=one.effect.name, joint=one.where)


def _parameter(one: Value) -> FoundParameter:
    """A parameter, whether the recordings determine it, and what it has changed from."""
    parameter = FoundParameter(
        name=one.name,
        value=one.value,
        std_dev=one.std_dev,
        unit=one.unit,
        minimum=one.minimum,
        determined=is_determined(one.value, one.std_dev, one.minimum),
    )
    if one.before is None:
        return parameter
    (before, before_std_dev), (change, change_std_dev) = one.before, one.change
    return ChangedParameter(
        **dict(parameter),
        before=before,
        before_std_dev=before_std_dev,
        change=change,
        change_std_dev=change_std_dev,
    )


def _near(near: Nearest | None) -> NearestEffects | None:
    """What effects would do that are not named, and why that does not do."""
    if near is None:
        return None
    return NearestEffects(
        effects=[
            NearEffect(
                **dict(_effect(one.shaped.candidate)), score=one.score, threshold=one.threshold
            )
            for one in near.effects
        ],
        explained_share=near.explained,
        gap={
            joint: NearestGap(before=before, after=after)
            for joint, before, after in zip(near.joints, near.before, near.after, strict=True)
        },
        objection=near.objection,
    )


def _side(gap: Gap, error: np.ndarray, motion: MotionValidation) -> dict[str, GapSide]:
    return {
        joint: GapSide(
            force_relative_error=error[j],
            noise_floor=gap.floor[j],
            sample_noise=gap.sample_noise[j],
            best_achievable=gap.best[j],
            motion_error=motion.position_rms[j],
            motion_displacement=motion.displacement_rms[j],
            motion_reason=motion.reason,
        )
        for j, joint in enumerate(gap.joints)
    }


def _untried(candidates: Mapping[Candidate, str]) -> list[Untried]:
    return [
        Untried(effect=candidate.type, joint=candidate.where, reason=reason)
        for candidate, reason in candidates.items()
    ]
