"""findings.json: the answer for programs."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.energy import acting
from crane_identification.diagnosis.extension import Finding, Value, carried_in
from crane_identification.diagnosis.flow_and_load_findings import balance, of_flow, of_load
from crane_identification.diagnosis.gap import Gap
from crane_identification.diagnosis.region import (
    Region,
    correlation_left,
    energy_shares,
    regions,
)
from crane_identification.diagnosis.variables import feature_unit
from crane_identification.notation import is_determined
from crane_identification.validation.motion_validation import MotionValidation

WHITE = 0.25  # correlation of neighbouring rows up to which what is left counts as white


def write(path: Path | str, diagnosis: Diagnosis, suspicions: Sequence[str] = ()) -> None:
    """Write the file, with what is suspicious of the recordings."""
    answer = content(diagnosis) | {"suspicions": list(suspicions)}
    text = json.dumps(answer, indent=2, allow_nan=False, ensure_ascii=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """All of it as plain mappings; numbers that are not known are null."""
    fit, proof, gap = diagnosis.fit, diagnosis.proof, diagnosis.gap
    thresholds = diagnosis.thresholds
    return _plain(
        {
            "verdict": diagnosis.verdict.value,
            "reason": diagnosis.reason,
            "values_kept": fit.fixed,
            "where": _where(diagnosis),
            "findings": [_finding(diagnosis, one) for one in diagnosis.findings]
            + [
                of_flow(diagnosis, flow.joint, one)
                for flow in diagnosis.flow.found
                for one in flow.missing
            ]
            + [of_load(diagnosis, one) for one in gap.loads if one.found],
            "nearest": _nearest(diagnosis),
            "gap": {
                "before": _side(gap, gap.before, gap.motion_before),
                "after": _side(gap, gap.after, gap.motion_after),
                "closed": dict(zip(diagnosis.joints, gap.closed, strict=True)),
                "loads": [
                    {"recording": one.recording, "value": one.mass, "std_dev": one.std_dev}
                    for one in gap.loads
                ],
            },
            "left": {
                joint: {
                    "white": abs(correlation) < WHITE,
                    "correlation": correlation,
                    "learnable_share": share,
                    "law": law,
                    "beyond_noise": times > thresholds.gates.floor_factor,
                    "region": _region(diagnosis, region),
                }
                for joint, correlation, share, law, times, region in zip(
                    diagnosis.joints,
                    correlation_left(fit.evidence, proof.trial),
                    proof.trial.learnt.share,
                    proof.trial.law,
                    gap.over_floor(np.maximum(gap.after, gap.training_after)),
                    regions(fit, proof.trial),
                    strict=True,
                )
            },
            "undetermined": fit.undetermined,
            "clock": {
                "through_session": fit.session.fallback is None,
                "reason": fit.session.fallback,
            },
            "needs_units": fit.uncalibrated,
            "warnings": diagnosis.warnings,
            "without": sorted(diagnosis.without),
            "not_testable": _reasons(diagnosis.search.untestable),
            "not_observable": _reasons(diagnosis.search.unobservable)
            + [
                {"effect": effect, "joint": joint, "reason": reason}
                for (effect, joint), reason in diagnosis.flow.unobservable.items()
            ],
            "pulsations": [vars(one) for one in proof.pulsations],
            "flow": {flow.joint: balance(flow) for flow in diagnosis.flow.found},
            "detectable_strength": diagnosis.detectable,
        }
    )


def _where(diagnosis: Diagnosis) -> dict[str, Any]:
    motion, first = diagnosis.gap.motion_before, diagnosis.proof.before
    shares, places = energy_shares(diagnosis.training, first), regions(diagnosis.fit, first)
    return {
        joint: {
            "energy_share": shares[j],
            "motion_error": motion.position_rms[j],
            "region": _region(diagnosis, places[j]),
        }
        for j, joint in enumerate(diagnosis.joints)
    }


def _region(diagnosis: Diagnosis, region: Region | None) -> dict[str, Any] | None:
    if region is None:
        return None
    setting, counts = diagnosis.before.setting, bool(diagnosis.fit.uncalibrated)
    return {
        "variable": region.variable,
        "range": [region.low, region.high],
        "unit": feature_unit(region.variable, setting, counts),
        "share": region.share,
    }


def _finding(diagnosis: Diagnosis, finding: Finding) -> dict[str, Any]:
    judged, candidate = finding.judged, finding.candidate
    runner = judged.runner_up
    return {
        "effect": candidate.type,
        "name": candidate.effect.name,
        "joint": candidate.where,
        "changed": candidate.changes,
        "class_members": [
            {"effect": one.type, "name": one.effect.name, "joint": one.where}
            for one in judged.indistinct
        ],
        "parameters": [_parameter(value) for value in finding.parameters],
        "carried_in": carried_in(finding, diagnosis.training.sources),
        "score": judged.score,
        "threshold": judged.threshold,
        "false_alarm_rate": diagnosis.thresholds.method.false_alarm_rate,
        "runner_up": None
        if runner is None
        else {"effect": runner.type, "name": runner.effect.name, "joint": runner.where},
        "margin": judged.margin,
        "margin_needed": judged.needed,
        "visibility": judged.visibility,
        "strength": _strength(diagnosis, finding),
        "visible_strength": judged.strength,
        "held_out_gains": dict(zip(judged.fold_names, judged.held_out, strict=True)),
        "settled_by": candidate.effect.settled_by,
    }


def _parameter(one: Value) -> dict[str, Any]:
    """A parameter, whether the recordings determine it, and what it has changed from."""
    own = one.__dict__ | {"determined": is_determined(one.value, one.std_dev, one.minimum)}
    before = own.pop("before")
    if before is None:
        return own
    change, std_dev = one.change
    return own | {
        "before": before[0],
        "before_std_dev": before[1],
        "change": change,
        "change_std_dev": std_dev,
    }


def _strength(diagnosis: Diagnosis, finding: Finding) -> float:
    return acting(diagnosis.training, finding.judged.shaped.columns, finding.added)


def _nearest(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """What comes closest where nothing is named, and why that does not do."""
    near = diagnosis.answer.nearest
    if near is None:
        return None
    return {
        "effects": [
            {
                "effect": one.shaped.candidate.type,
                "name": one.shaped.candidate.effect.name,
                "joint": one.shaped.candidate.where,
                "score": one.score,
                "threshold": one.threshold,
            }
            for one in near.effects
        ],
        "explained_share": near.explained,
        "gap": {
            joint: {"before": before, "after": after}
            for joint, before, after in zip(near.joints, near.before, near.after, strict=True)
        },
        "objection": near.objection,
    }


def _side(gap: Gap, error: np.ndarray, motion: MotionValidation) -> dict[str, Any]:
    return {
        joint: {
            "force_relative_error": error[j],
            "noise_floor": gap.floor[j],
            "best_achievable": gap.best[j],
            "motion_error": motion.position_rms[j],
            "motion_displacement": motion.displacement_rms[j],
            "motion_reason": motion.reason,
        }
        for j, joint in enumerate(gap.joints)
    }


def _reasons(candidates: dict[Any, str]) -> list[dict[str, str]]:
    return [
        {"effect": candidate.type, "joint": candidate.where, "reason": reason}
        for candidate, reason in candidates.items()
    ]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
